"""Steering and throttle from keys, mouse and gamepad, with the original simulator's rates."""

from collections.abc import Set
from dataclasses import dataclass

from panda3d import core

# As in the original: a key changes steering by 0.05 every 0.02 s; Unity's axes (throttle, and
# steering on its way back to 0) change by 3 per second.
STEERING_PER_S = 2.5
AXIS_PER_S = 3.0
CRUISE_THROTTLE = 0.4
MOUSE_FULL_LOCK = 2 / 3  # share of the window's width, from where the button was pressed
DEAD_ZONE = 0.1  # smaller values of a stick count as 0
TAKES_OVER = 0.05  # a pedal pressed beyond this ends cruising

LEFT, RIGHT = frozenset({"arrow_left", "a"}), frozenset({"arrow_right", "d"})
UP, DOWN = frozenset({"arrow_up", "w"}), frozenset({"arrow_down", "s"})
MOUSE_BUTTON = "mouse1"
Axis, Kind = core.InputDevice.Axis, core.InputDevice.DeviceClass
# For each kind of device: the axes of steering, accelerator and brake.
AXES = {
    Kind.gamepad: (Axis.left_x, Axis.right_trigger, Axis.left_trigger),
    Kind.steering_wheel: (Axis.wheel, Axis.accelerator, Axis.brake),
}
TRIGGERS = (core.GamepadButton.rtrigger(), core.GamepadButton.ltrigger())


@dataclass(frozen=True)
class Hands:
    """Input of a person at one moment.

    Args:
        held: Panda3D's names of the keys and mouse buttons that are down.
        pointer: x of the mouse, 0 at the window's left edge, 1 at its right.
        stick: position of a gamepad's stick or a steering wheel, -1..1, right positive.
        pedals: accelerator minus brake, -1..1.
    """

    held: Set[str] = frozenset()
    pointer: float = 0.5
    stick: float = 0.0
    pedals: float = 0.0


class HandControl:
    """Steering and throttle over time; keys take precedence over mouse and gamepad."""

    def __init__(self) -> None:
        self.cruising = False
        self.release()

    def release(self) -> None:
        """Reset steering and throttle to 0, as after the car is put back."""
        self.steering = self.throttle = 0.0
        self._pressed_at: float | None = None

    def step(self, seconds: float, hands: Hands) -> tuple[float, float]:
        """Return steering and throttle after `seconds`, -1..1 each, right and forward positive."""
        self.steering = self._steer(seconds, hands)
        self.throttle = self._accelerate(seconds, hands)
        return self.steering, self.throttle

    def _steer(self, seconds: float, hands: Hands) -> float:
        way = bool(hands.held & RIGHT) - bool(hands.held & LEFT)
        if MOUSE_BUTTON not in hands.held:
            self._pressed_at = None
        elif self._pressed_at is None:
            self._pressed_at = hands.pointer
        if way:
            return _clamp(self.steering + way * STEERING_PER_S * seconds)
        if self._pressed_at is not None:
            return _clamp((hands.pointer - self._pressed_at) / MOUSE_FULL_LOCK)
        if abs(hands.stick) > DEAD_ZONE:
            beyond = (abs(hands.stick) - DEAD_ZONE) / (1 - DEAD_ZONE)
            return _clamp(beyond if hands.stick > 0 else -beyond)
        return _towards(self.steering, 0.0, AXIS_PER_S * seconds)

    def _accelerate(self, seconds: float, hands: Hands) -> float:
        way = bool(hands.held & UP) - bool(hands.held & DOWN)
        # The original keeps cruising whatever is pressed; here braking ends it.
        if way < 0 or abs(hands.pedals) > TAKES_OVER:
            self.cruising = False
        if self.cruising:
            return CRUISE_THROTTLE
        if way:
            # From accelerating directly to braking, as Unity's axes with "snap".
            begin = self.throttle if self.throttle * way > 0 else 0.0
            return _towards(begin, float(way), AXIS_PER_S * seconds)
        if abs(hands.pedals) > TAKES_OVER:
            return _clamp(hands.pedals)
        return _towards(self.throttle, 0.0, AXIS_PER_S * seconds)


def _clamp(value: float) -> float:
    return min(max(value, -1.0), 1.0)


def _towards(value: float, target: float, change: float) -> float:
    return min(value + change, target) if value < target else max(value - change, target)


class Gamepads:
    """All devices that can steer; the one that is moved farthest is used."""

    def __init__(self) -> None:
        # A missing /dev/input is not an error.
        core.loadPrcFileData("", "notify-level-device fatal")
        self.manager = core.InputDeviceManager.getGlobalPtr()

    def read(self) -> tuple[float, float]:
        """Return stick, -1..1, right positive, and accelerator minus brake, -1..1; 0, 0 if none."""
        self.manager.update()
        readings = [(0.0, 0.0)]
        for kind in AXES:
            readings += [read_device(device) for device in self.manager.getDevices(kind)]
        return max((one[0] for one in readings), key=abs), max(
            (one[1] for one in readings), key=abs
        )


def read_device(device: core.InputDevice) -> tuple[float, float]:
    """Return one device's stick, and its accelerator minus its brake."""
    device.poll()
    steer, *pedals = (_axis(device, axis) for axis in AXES[device.device_class])
    # Cheap gamepads have buttons instead of triggers.
    pressed = [device.findButton(button).pressed for button in TRIGGERS]
    gas, brake = (max(*pair) for pair in zip(pedals, map(float, pressed), strict=True))
    return steer, gas - brake


def _axis(device: core.InputDevice, axis: core.InputDevice.Axis) -> float:
    found = device.findAxis(axis)
    return found.value if found.known else 0.0
