"""The networks of the zoo: one file and one YAML in `conf/model` for each.

A network is a plain `torch.nn.Module`. Its constructor takes `shape`, the `(channels, height,
width)` of its view, and the settings of its YAML. `forward` takes uint8 or float images
`[N, C, H, W]` in 0..255 and returns the steering `[N, 1]` in -1..1. What else it takes and returns,
such as the speed, the throttle or a spread, its attribute `facts` says: the dataclass
`zoo.models.network_facts.NetworkFacts`. `LogSpread` of `layers` bounds a spread.

A network that looks at several frames, or predicts several steps, is a `zoo.models.memory.Memory`.
"""
