"""Has Perfetto's own trace processor read a trace that `orime-probe --trace` wrote.

PyPI's perfetto fetches the processor's binary at its first use: where it cannot, this says so and
exits 77 (skipped). PERFETTO_TRACE_PROCESSOR names one that is there already.

usage: python tests/perfetto_trace.py TRACE
"""
import json, os, sys, tempfile

SKIPPED = 77


def processor(path):
    from perfetto.trace_processor import TraceProcessor, TraceProcessorConfig
    binary = os.environ.get("PERFETTO_TRACE_PROCESSOR")
    return TraceProcessor(trace=path, config=TraceProcessorConfig(bin_path=binary))


def skip_without_processor():
    """Whether there is one shows in a trace that is good for certain."""
    event = {"ph": "X", "name": "a", "ts": 1, "dur": 2, "pid": 1, "tid": 1}
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump({"traceEvents": [event]}, file)
        file.flush()
        try:
            processor(file.name).close()
        except Exception as error:  # No package, no network, a binary that does not run.
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
    errors = "select count(*) as n from stats where severity in ('error', 'data_loss') and value > 0"
    assert count(errors) == 0, "nothing of it is refused"
    names = {row.name for row in reader.query("select name from process where name is not null")}
    stages = {f"orime-{stage}" for stage in ("capture", "segment", "register", "simulate")}
    assert stages <= names, names
    # An arrow from capture to segment, to register, to simulate of one frame set.
    assert count("select count(*) as n from flow") > 3, "frames lead through all processes"


if __name__ == "__main__":
    main(sys.argv[1])
