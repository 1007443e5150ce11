"""What the network looks at while it drives: a picture of it now and then, if somebody looks."""

import time

import cv2
import eventlet
import numpy as np
import torch

from zoo.drive.background_call import beside
from zoo.drive.driver import Driver
from zoo.saliency.visual_backprop import Saliency, overlay

PERIOD_S = 0.5


class Gaze:
    """Draws `zoo.saliency.visual_backprop` over the latest frame, in a thread of its own.

    Only when asked, and at most twice a second, however many ask.

    Args:
        driver: whose policy and frames.
    """

    def __init__(self, driver: Driver) -> None:
        self.driver = driver
        self._saliency: Saliency | None = None
        self._policy: object = None
        self._picture = b""
        self._began_s = -np.inf
        self._busy = False

    def picture(self) -> bytes:
        """A JPEG of 320 x 160, at most `PERIOD_S` old.

        Raises:
            Exception: as the network does that cannot be looked through.
        """
        while self._busy:
            eventlet.sleep(0.02)
        if time.monotonic() - self._began_s >= PERIOD_S:
            self._busy, self._began_s, self._picture = True, time.monotonic(), b""
            try:
                self._picture = beside(self._draw)
            except Exception:
                self._began_s = -np.inf  # whoever asks next is told the same
                raise
            finally:
                self._busy = False
        return self._picture

    def _draw(self) -> bytes:
        torch.set_num_threads(1)  # of this thread: the driver's own keep theirs
        state, policy = self.driver.latest(), self.driver.policy
        if state.frame is None:
            return b""
        if policy is not self._policy:
            self._saliency, self._policy = Saliency(policy), policy
        return jpeg(overlay(state.frame, self._saliency(state.frame, state.speed_mph)))


def jpeg(frame: np.ndarray) -> bytes:
    """A picture uint8 [H, W, 3] RGB, in the bytes of a file."""
    quality = (cv2.IMWRITE_JPEG_QUALITY, 88)
    return cv2.imencode(".jpg", np.ascontiguousarray(frame[..., ::-1]), quality)[1].tobytes()
