"""`docs/metrics.md`, the page of all metrics of a drive: `python -m zoo.results --metrics`."""

from inspect import getdoc

from zoo.drives.metrics import METRICS

HEAD = """# The metrics of a drive

Written by `python -m zoo.results --metrics > docs/metrics.md` from the functions of
[zoo/drives/metrics.py](../zoo/drives/metrics.py). Every drive has them in its `drive.json`,
wherever it took place: in the embedded world, on a socket, or in the replay of a recording.
`metrics.json` has their mean and sample standard deviation over the drives of a track. A *share*
is from 0 to 1, shown in percent. Rows whose value is not known are left out; a figure that is not
known is `null`.

| key | metric | unit | direction | definition | source |
|---|---|---|---|---|---|
"""


def metrics_page() -> str:
    """Return the page as Markdown: a line for each metric, in the order of the tables."""
    lines = [
        f"| `{one.name}` | {one.label} | {one.unit} | {one.direction} "
        f"| {' '.join(str(getdoc(one.function)).split())} | {one.source} |\n"
        for one in METRICS.values()
    ]
    return HEAD + "".join(lines)
