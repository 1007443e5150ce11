"""Published figures of warnings before failures, on the original simulator, in percent."""

# ThirdEye, Stocco et al. 2022, "ThirdEye: attention maps for safe autonomous driving systems";
# levels of weather; method, seconds before the failure, recall, precision, false-positive rate, F3.
THIRDEYE = (
    ("attention maps", 1, 92, 49, 4, 84),
    ("autoencoder on the image", 1, 100, 24, 7, 75),
)
LINES = (
    "ThirdEye's best F3 3 s ahead: 79",
    "Grewal et al. 2024, Monte-Carlo dropout: AUC 84 %",
)
