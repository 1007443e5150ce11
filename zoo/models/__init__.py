"""The zoo: one network a file, one YAML in `conf/model` each.

A network is a plain `torch.nn.Module` whose constructor takes `shape`, the `(channels, height,
width)` of the view it is fed, and the settings of its YAML. `forward` takes uint8 or float images
`[N, C, H, W]` in 0..255 (and, where the class says `takes_speed = True`, the speed `[N]` in mph)
and returns `[N, outputs]`, steering first, in -1..1.
"""
