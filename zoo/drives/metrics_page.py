"""The page of all metrics of a drive, `docs/metrics.md`: `drivezoo results --metrics`."""

from inspect import getdoc

from zoo.drives.metrics import METRICS

HEAD = """# The metrics of a drive

Written by `drivezoo results --metrics > docs/metrics.md` from the functions of
[zoo/drives/metrics.py](../zoo/drives/metrics.py).

A drive is a sequence of rows, one for each time step *i*. A row holds the time `t[i]` in seconds,
the cross-track error `e[i]` in metres (the signed distance of the car from the centreline, positive
is right), the steering `s[i]` from -1 to 1, its spread `d[i]` (a standard deviation, if the policy
predicts one), the speed `v[i]` in mph, and whether an intervention begins. In the embedded world,
time is simulated time, and a row is 1/15 s by default (`frame_rate=15`). On a socket, a row is one
telemetry message.

Every drive has these metrics in its `drive.json`: in the embedded world, on a socket, and in the
replay of a recording. `metrics.json` has their mean and sample standard deviation (n - 1) over the
drives of a track. Means over rows leave out the rows without a value, such as those that a person
drove on a socket. A metric that is unknown, or infinite, is `null` in these files. A *share* is
shown in percent in tables.
"""


def metrics_page() -> str:
    """Return the page as Markdown: a table of all metrics, then a definition of each."""
    rows = [
        f"| [`{one.name}`](#{one.name}) | {one.label} | {one.unit} | {one.range} "
        f"| {one.direction} | {one.source} |\n"
        for one in METRICS.values()
    ]
    definitions = [f"\n## `{one.name}`\n\n{getdoc(one.function)}\n" for one in METRICS.values()]
    head = "\n| key | metric | unit | range | direction | source |\n|---|---|---|---|---|---|\n"
    return "".join([HEAD, head, *rows, *definitions])
