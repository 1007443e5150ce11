"""Effects on rendered frames: fog, bonnet, exposure, rain, blur and noise.

The bonnet's outlines are those of `zoo.base.rig.UDACITY`.
"""

import cv2
import numpy as np

from zoo.base.rig import UDACITY, Camera, Outline, Rig
from zoo.simulator.udacity_car import FRAME_HEIGHT, FRAME_WIDTH, camera_matrix
from zoo.simulator.weather import Weather

FINE = 4

TAN, PALE_TAN, DARK_TAN = (143, 132, 105), (150, 143, 120), (126, 118, 96)
GLASS, LAMP, RUBBER = (148, 151, 136), (240, 236, 224), (62, 58, 50)

# Colours of the outlines that `UDACITY` has of its own car, from back to front.
COLOURS = {
    "center": (PALE_TAN, TAN, RUBBER, GLASS),
    "left": (TAN, PALE_TAN, GLASS, LAMP, GLASS),
    "right": (DARK_TAN, PALE_TAN, GLASS, LAMP, TAN),
}
SEAMS: dict[str, Outline] = {
    "left": ((227, 143), (260, 160)),
    "right": ((81, 143), (44, 160)),
}
FOG_RGB = np.array([200, 205, 205], np.float32)
HORIZON_M = 300.0  # assumed distance of everything above the horizon


def bonnet_image(camera: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the bonnet in a camera's frame, and its cover.

    The bonnet is RGB float32 [H, W, 3] in 0..255, the cover float32 [H, W, 1] in 0..1. It is drawn
    larger and averaged, for smooth edges.
    """
    size = (FRAME_HEIGHT * FINE, FRAME_WIDTH * FINE)
    bonnet, own = np.zeros((*size, 3), np.float32), UDACITY.cameras[camera]
    for colour, corners in zip(COLOURS[camera], _corners(own, FINE), strict=True):
        cv2.fillPoly(bonnet, [corners], colour)
    if camera in SEAMS:
        start, end = (tuple(int(FINE * v) for v in corner) for corner in SEAMS[camera])
        cv2.line(bonnet, start, end, RUBBER, FINE)
    # The average is of covered pixels only; otherwise edges darken.
    cover = own_car_cover(own)
    averages = cv2.resize(bonnet, (FRAME_WIDTH, FRAME_HEIGHT), interpolation=cv2.INTER_AREA)
    return averages / np.maximum(cover, 1e-6), cover


def own_car_cover(camera: Camera) -> np.ndarray:
    """Return the cover of the car's own parts in a camera's frame; see `bonnet_image`."""
    width, height = camera.size
    cover = np.zeros((height * FINE, width * FINE), np.float32)
    for corners in _corners(camera, FINE):
        cv2.fillPoly(cover, [corners], 1.0)
    return cv2.resize(cover, (width, height), interpolation=cv2.INTER_AREA)[..., None]


def _corners(camera: Camera, fine: int) -> list[np.ndarray]:
    return [np.round(np.array(polygon) * fine).astype(np.int32) for polygon in camera.own_car]


class Air:
    """Effects of a weather on frames, uint8 [H, W, 3], RGB; deterministic for a seed.

    The software renderer gives no depth. Therefore fog uses each pixel's distance to a level plain,
    and a near tree fades as much as the mountain behind it.

    Args:
        weather: weather whose effects to apply.
        seed: random seed of rain and noise.
        rig: cameras; a bonnet is drawn in the frames of those that show their own car.
    """

    def __init__(self, weather: Weather, seed: int, rig: Rig) -> None:
        self.weather, self.seed = weather, seed
        self.cameras = tuple(rig.cameras)
        self.bonnets = {
            name: _bonnet_rows(name) for name, camera in rig.cameras.items() if camera.own_car
        }
        self.exposure = np.clip(np.arange(256) * weather.brightness, 0, 255).astype(np.uint8)
        first = next(iter(rig.cameras.values()))
        self.fog = _fog_share(weather.fog, first) if weather.fog else None

    def __call__(self, frame: np.ndarray, camera: str, tick: int) -> np.ndarray:
        """Return a camera's frame number `tick` with the effects; may change `frame`."""
        weather = self.weather
        if self.fog is not None:
            frame = (frame + (FOG_RGB - frame) * self.fog).astype(np.uint8)
        if camera in self.bonnets:
            first, colour, keep = self.bonnets[camera]
            frame[first:] = frame[first:] * keep + colour
        if weather.brightness != 1:
            frame = cv2.LUT(frame, self.exposure)
        if weather.rain or weather.noise:  # a generator costs as much as the bonnet
            rng = np.random.default_rng((self.seed, tick, self.cameras.index(camera)))
        if weather.rain:
            frame = _add_rain(frame, rng, weather.rain)
        # Blur comes before noise, because light passes the lens before the sensor.
        if weather.blur:
            frame = cv2.GaussianBlur(frame, (0, 0), weather.blur)
        if weather.noise:
            noise = rng.standard_normal(frame.shape, np.float32) * weather.noise
            frame = np.clip(frame + noise, 0, 255).astype(np.uint8)
        return frame


def _bonnet_rows(camera: str) -> tuple[int, np.ndarray, np.ndarray]:
    """Return the bonnet's first row, its colours times its cover, and the share not covered."""
    colour, cover = bonnet_image(camera)
    first = int(np.argmax(cover.any((1, 2))))
    return first, (colour * cover)[first:], (1 - cover)[first:]


def _fog_share(fog: float, camera: Camera) -> np.ndarray:
    """Return the share of fog in each pixel, float32 [H, W, 1] (Beer-Lambert law)."""
    (width, height), focal = camera.size, camera.focal_px
    v, u = np.mgrid[0:height, 0:width] + 0.5
    rays = np.stack([(u - width / 2) / focal, (height / 2 - v) / focal, np.ones_like(u)], -1)
    rays = rays @ camera_matrix(camera.pitch_down_deg, camera.yaw_right_deg, camera.roll_deg).T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    away = np.minimum(camera.up_m / np.maximum(-rays[..., 1], 1e-6), HORIZON_M)
    # Fog is a layer, so it gets thinner towards the zenith.
    away = np.where(rays[..., 1] > 0, HORIZON_M * np.exp(-4 * rays[..., 1]), away)
    return (1 - np.exp(-away * fog**2 * 0.06)).astype(np.float32)[..., None]


def _add_rain(frame: np.ndarray, rng: np.random.Generator, rain: float) -> np.ndarray:
    """Add pale, slanted streaks."""
    height, width = frame.shape[:2]
    streaks = np.zeros((height, width), np.uint8)
    for _ in range(int(rain * 160)):
        x, y = int(rng.integers(0, width)), int(rng.integers(0, height))
        length = int(rng.integers(3, 12))
        cv2.line(streaks, (x, y), (x + length // 4, y + length), 70, 1)
    return cv2.add(frame, cv2.merge([streaks] * 3))
