"""What happens between the world and the file: fog, the bonnet, exposure, rain, blur, noise."""

import cv2
import numpy as np

from simulator.rig import (
    CAMERA_POSITIONS,
    CAMERAS,
    FOCAL_PX,
    FRAME_HEIGHT,
    FRAME_WIDTH,
    PITCH_DOWN_DEG,
    ROLL_DEG,
    YAW_RIGHT_DEG,
    camera_matrix,
)
from simulator.scenery.bonnet import bonnet_picture
from simulator.weather import Weather

FOG_RGB = np.array([200, 205, 205], np.float32)
HORIZON_M = 300.0  # how far away what stands above the horizon is taken to be


class Air:
    """One weather's effects on uint8 [160, 320, 3] RGB pictures; deterministic for a seed.

    Fog takes each pixel's distance from a level plain, not from the scene: the software renderer
    gives no depth. A tree close by fades like the mountain behind it.
    """

    def __init__(self, weather: Weather, seed: int) -> None:
        self.weather, self.seed = weather, seed
        self.bonnets = {camera: _bonnet_rows(camera) for camera in CAMERAS}
        gain = np.arange(256) * weather.brightness
        self.exposure = np.clip(gain, 0, 255).astype(np.uint8)
        self.fog = _fog_share(weather.fog) if weather.fog else None

    def __call__(self, picture: np.ndarray, camera: str, tick: int) -> np.ndarray:
        """The finished picture of a camera at frame number `tick`."""
        weather = self.weather
        if self.fog is not None:
            picture = (picture + (FOG_RGB - picture) * self.fog).astype(np.uint8)
        first, colour, keep = self.bonnets[camera]
        picture[first:] = picture[first:] * keep + colour
        if weather.brightness != 1:
            picture = cv2.LUT(picture, self.exposure)
        rng = np.random.default_rng((self.seed, tick, CAMERAS.index(camera)))
        if weather.rain:
            picture = _with_rain(picture, rng, weather.rain)
        # The lens blurs what there is to see; the noise is the sensor's, behind it.
        if weather.blur:
            picture = cv2.GaussianBlur(picture, (0, 0), weather.blur)
        if weather.noise:
            noise = rng.standard_normal(picture.shape, np.float32) * weather.noise
            picture = np.clip(picture + noise, 0, 255).astype(np.uint8)
        return picture


def _bonnet_rows(camera: str) -> tuple[int, np.ndarray, np.ndarray]:
    """The first row that the bonnet touches; its colours times its cover, and what stays."""
    colour, cover = bonnet_picture(camera)
    first = int(np.argmax(cover.any((1, 2))))
    return first, (colour * cover)[first:], (1 - cover)[first:]


def _fog_share(fog: float) -> np.ndarray:
    """How much of each pixel is fog, float32 [160, 320, 1] (Beer-Lambert over the distance)."""
    v, u = np.mgrid[0:FRAME_HEIGHT, 0:FRAME_WIDTH] + 0.5
    rays = np.stack(
        [(u - FRAME_WIDTH / 2) / FOCAL_PX, (FRAME_HEIGHT / 2 - v) / FOCAL_PX, np.ones_like(u)], -1
    )
    rays = rays @ camera_matrix(PITCH_DOWN_DEG, YAW_RIGHT_DEG, ROLL_DEG).T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    height = CAMERA_POSITIONS["center"][1]
    away = np.minimum(height / np.maximum(-rays[..., 1], 1e-6), HORIZON_M)
    # Thinner towards the zenith, as a layer of fog is.
    away = np.where(rays[..., 1] > 0, HORIZON_M * np.exp(-4 * rays[..., 1]), away)
    return (1 - np.exp(-away * fog**2 * 0.06)).astype(np.float32)[..., None]


def _with_rain(picture: np.ndarray, rng: np.random.Generator, rain: float) -> np.ndarray:
    """Pale streaks, falling at a slant."""
    streaks = np.zeros(picture.shape[:2], np.uint8)
    for _ in range(int(rain * 160)):
        x, y = int(rng.integers(0, FRAME_WIDTH)), int(rng.integers(0, FRAME_HEIGHT))
        length = int(rng.integers(3, 12))
        cv2.line(streaks, (x, y), (x + length // 4, y + length), 70, 1)
    return cv2.add(picture, cv2.merge([streaks] * 3))
