"""Names of the drivers that are not checkpoints; without slow imports."""

# Steering of 0; mean steering of the training data; the expert; the expert with late commands.
BASELINES = ("zero", "mean", "expert", "expert_late")
HUMAN = "human"  # a person at keyboard, mouse or gamepad
NO_CHECKPOINT = (*BASELINES, HUMAN)
