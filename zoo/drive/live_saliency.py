"""Saliency of the network during a drive, for the live page."""

import time

import cv2
import eventlet
import numpy as np
import torch

from zoo.drive.background_call import call_in_thread
from zoo.drive.driver import Driver
from zoo.saliency.visual_backprop import Saliency, overlay

PERIOD_S = 0.5


class LiveSaliency:
    """Saliency over the latest frame, computed in a thread, at most twice per second.

    Args:
        driver: driver whose policy and frames are shown.
    """

    def __init__(self, driver: Driver) -> None:
        self.driver = driver
        self._saliency: Saliency | None = None
        self._policy: object = None
        self._image = b""
        self._began_s = -np.inf
        self._busy = False

    def image(self) -> bytes:
        """Return a JPEG of 320 x 160 pixels, at most `PERIOD_S` old; empty before the first frame.

        Raises:
            Exception: the saliency of this network cannot be computed.
        """
        while self._busy:
            eventlet.sleep(0.02)
        if time.monotonic() - self._began_s >= PERIOD_S:
            self._busy, self._began_s, self._image = True, time.monotonic(), b""
            try:
                self._image = call_in_thread(self._draw)
            except Exception:
                self._began_s = -np.inf  # the next call tries again
                raise
            finally:
                self._busy = False
        return self._image

    def _draw(self) -> bytes:
        torch.set_num_threads(1)  # of this thread alone; the driver's thread keeps its number
        state, policy = self.driver.latest(), self.driver.policy
        if state.frame is None:
            return b""
        if policy is not self._policy:
            self._saliency, self._policy = Saliency(policy), policy
        return jpeg(overlay(state.frame, self._saliency(state.frame, state.speed_mph)))


def jpeg(frame: np.ndarray) -> bytes:
    """Encode an image, uint8 [H, W, 3] RGB, as JPEG."""
    quality = (cv2.IMWRITE_JPEG_QUALITY, 88)
    return cv2.imencode(".jpg", np.ascontiguousarray(frame[..., ::-1]), quality)[1].tobytes()
