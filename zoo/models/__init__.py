"""The networks of the zoo: one file and one YAML in `conf/model` for each.

A network is a plain `torch.nn.Module`. Its constructor takes `shape`, the `(channels, height,
width)` of its view, and the settings of its YAML. `forward` takes uint8 or float images
`[N, C, H, W]` in 0..255, and the speed `[N]` in mph if the class sets `takes_speed = True`. It
returns `[N, outputs]` in -1..1, steering first. With `predicts_spread = True` it returns one more
column: the logarithm of the steering's standard deviation, which `LogSpread` of `layers` bounds.

A network that looks at several frames, or predicts several steps, is a `zoo.models.memory.Memory`.
"""
