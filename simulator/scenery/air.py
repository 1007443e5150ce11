"""Effects on rendered frames: fog, bonnet, exposure, rain, blur and noise."""

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
from simulator.scenery.bonnet import bonnet_image
from simulator.weather import Weather

FOG_RGB = np.array([200, 205, 205], np.float32)
HORIZON_M = 300.0  # assumed distance of everything above the horizon


class Air:
    """Effects of a weather on frames, uint8 [160, 320, 3], RGB; deterministic for a seed.

    The software renderer gives no depth. Therefore fog uses each pixel's distance to a level plain,
    and a near tree fades as much as the mountain behind it.

    Args:
        weather: weather whose effects to apply.
        seed: random seed of rain and noise.
    """

    def __init__(self, weather: Weather, seed: int) -> None:
        self.weather, self.seed = weather, seed
        self.bonnets = {camera: _bonnet_rows(camera) for camera in CAMERAS}
        gain = np.arange(256) * weather.brightness
        self.exposure = np.clip(gain, 0, 255).astype(np.uint8)
        self.fog = _fog_share(weather.fog) if weather.fog else None

    def __call__(self, frame: np.ndarray, camera: str, tick: int) -> np.ndarray:
        """Return a camera's frame number `tick` with the effects; may change `frame`."""
        weather = self.weather
        if self.fog is not None:
            frame = (frame + (FOG_RGB - frame) * self.fog).astype(np.uint8)
        first, colour, keep = self.bonnets[camera]
        frame[first:] = frame[first:] * keep + colour
        if weather.brightness != 1:
            frame = cv2.LUT(frame, self.exposure)
        if weather.rain or weather.noise:  # a generator costs as much as the bonnet
            rng = np.random.default_rng((self.seed, tick, CAMERAS.index(camera)))
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


def _fog_share(fog: float) -> np.ndarray:
    """Return the share of fog in each pixel, float32 [160, 320, 1] (Beer-Lambert law)."""
    v, u = np.mgrid[0:FRAME_HEIGHT, 0:FRAME_WIDTH] + 0.5
    rays = np.stack(
        [(u - FRAME_WIDTH / 2) / FOCAL_PX, (FRAME_HEIGHT / 2 - v) / FOCAL_PX, np.ones_like(u)], -1
    )
    rays = rays @ camera_matrix(PITCH_DOWN_DEG, YAW_RIGHT_DEG, ROLL_DEG).T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    height = CAMERA_POSITIONS["center"][1]
    away = np.minimum(height / np.maximum(-rays[..., 1], 1e-6), HORIZON_M)
    # Fog is a layer, so it gets thinner towards the zenith.
    away = np.where(rays[..., 1] > 0, HORIZON_M * np.exp(-4 * rays[..., 1]), away)
    return (1 - np.exp(-away * fog**2 * 0.06)).astype(np.float32)[..., None]


def _add_rain(frame: np.ndarray, rng: np.random.Generator, rain: float) -> np.ndarray:
    """Add pale, slanted streaks."""
    streaks = np.zeros(frame.shape[:2], np.uint8)
    for _ in range(int(rain * 160)):
        x, y = int(rng.integers(0, FRAME_WIDTH)), int(rng.integers(0, FRAME_HEIGHT))
        length = int(rng.integers(3, 12))
        cv2.line(streaks, (x, y), (x + length // 4, y + length), 70, 1)
    return cv2.add(frame, cv2.merge([streaks] * 3))
