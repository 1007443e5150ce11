"""The car's bonnet at the lower edge of each camera's frame.

The outlines were measured in pixels on the median of 80 of the original's frames.
"""

import cv2
import numpy as np

from simulator.rig import FRAME_HEIGHT, FRAME_WIDTH

FINE = 4  # drawn four times as large, then averaged, for smooth edges

TAN, PALE_TAN, DARK_TAN = (143, 132, 105), (150, 143, 120), (126, 118, 96)
GLASS, LAMP, RUBBER = (148, 151, 136), (240, 236, 224), (62, 58, 50)

Outline = tuple[tuple[float, float], ...]

# Filled shapes from back to front; x, y in pixels of 320 x 160.
SHAPES: dict[str, tuple[tuple[tuple[int, int, int], Outline], ...]] = {
    "center": (
        (
            PALE_TAN,
            ((36, 160), (45, 155.5), (67, 150), (88, 146), (105, 143), (117, 139.5), (130, 137.5))
            + ((172, 137.5), (185, 140.5), (200, 144), (215, 146.5), (238, 151), (264, 160)),
        ),
        (
            TAN,
            ((60, 160), (85, 154), (100, 151), (118, 146), (140, 143.7), (180, 144.5), (200, 148))
            + ((220, 153), (240, 160)),
        ),
        (
            RUBBER,
            ((91, 160), (117, 153.5), (133, 151.5), (150, 150.5), (185, 151.7), (218, 160)),
        ),
        (GLASS, ((99, 160), (121, 153.8), (150, 151.6), (185, 152.8), (215, 160))),
    ),
    "left": (
        (
            TAN,
            ((185, 160), (187, 154.5), (195, 149.5), (207, 144.5), (222, 143), (240, 141))
            + ((255, 139), (270, 137.5), (295, 137.5), (320, 140), (320, 160)),
        ),
        (PALE_TAN, ((255, 139), (270, 137.5), (295, 137.5), (320, 140), (320, 145), (270, 142))),
        (GLASS, ((186, 160), (188, 154.5), (197, 149.5), (200, 155), (200, 160))),
        (LAMP, ((198, 149), (207, 144.5), (222, 143.5), (217, 149), (213, 153), (206, 153))),
        (GLASS, ((303, 160), (304, 154.5), (310, 152), (320, 151), (320, 160))),
    ),
    "right": (
        (
            DARK_TAN,
            ((0, 135), (35, 135), (48, 137.5), (65, 140.5), (82, 143), (100, 143), (110, 147.5))
            + ((120, 151), (124, 160), (0, 160)),
        ),
        (PALE_TAN, ((0, 135), (35, 135), (55, 141), (30, 139), (0, 142))),
        (GLASS, ((110, 148.5), (120, 151), (124, 160), (111, 160))),
        (LAMP, ((86, 143), (105, 145.5), (109, 150), (103, 157.5), (94, 151))),
        (TAN, ((0, 145), (10, 147.5), (9, 160), (0, 160))),
    ),
}
SEAMS: dict[str, Outline] = {
    "left": ((227, 143), (260, 160)),
    "right": ((81, 143), (44, 160)),
}


def bonnet_image(camera: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the bonnet in a camera's frame, and its cover.

    The bonnet is RGB float32 [160, 320, 3] in 0..255, the cover float32 [160, 320, 1] in 0..1.
    """
    size = (FRAME_HEIGHT * FINE, FRAME_WIDTH * FINE)
    bonnet, cover = np.zeros((*size, 3), np.float32), np.zeros(size, np.float32)
    for colour, outline in SHAPES[camera]:
        corners = [np.round(np.array(outline) * FINE).astype(np.int32)]
        cv2.fillPoly(bonnet, corners, colour)
        cv2.fillPoly(cover, corners, 1.0)
    if camera in SEAMS:
        start, end = (tuple(int(FINE * v) for v in corner) for corner in SEAMS[camera])
        cv2.line(bonnet, start, end, RUBBER, FINE)
    small = (FRAME_WIDTH, FRAME_HEIGHT)
    # The average is of covered pixels only; otherwise edges darken.
    cover_small = cv2.resize(cover, small, interpolation=cv2.INTER_AREA)
    bonnet = cv2.resize(bonnet, small, interpolation=cv2.INTER_AREA)
    bonnet /= np.maximum(cover_small, 1e-6)[..., None]
    return bonnet, cover_small[..., None]
