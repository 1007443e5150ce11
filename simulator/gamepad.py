"""Gamepads and steering wheels that Panda3D knows; they may be plugged in at any time."""

from panda3d import core

Axis, Kind = core.InputDevice.Axis, core.InputDevice.DeviceClass
# For each kind of device: what steers, accelerates and brakes.
AXES = {
    Kind.gamepad: (Axis.left_x, Axis.right_trigger, Axis.left_trigger),
    Kind.steering_wheel: (Axis.wheel, Axis.accelerator, Axis.brake),
}
TRIGGERS = (core.GamepadButton.rtrigger(), core.GamepadButton.ltrigger())


class Gamepads:
    """All devices that can steer; the one that is moved farthest counts."""

    def __init__(self) -> None:
        # A machine without /dev/input is no fault.
        core.loadPrcFileData("", "notify-level-device fatal")
        self.manager = core.InputDeviceManager.getGlobalPtr()

    def read(self) -> tuple[float, float]:
        """Stick -1..1 (right positive), and accelerator minus brake -1..1; 0, 0 without any."""
        self.manager.update()
        readings = [(0.0, 0.0)]
        for kind in AXES:
            readings += [read_device(device) for device in self.manager.getDevices(kind)]
        return max((one[0] for one in readings), key=abs), max(
            (one[1] for one in readings), key=abs
        )


def read_device(device: core.InputDevice) -> tuple[float, float]:
    """One device's stick, and its accelerator minus its brake."""
    device.poll()
    steer, *pedals = (_axis(device, axis) for axis in AXES[device.device_class])
    # Cheap gamepads have buttons where others have triggers.
    pressed = [device.findButton(button).pressed for button in TRIGGERS]
    gas, brake = (max(*pair) for pair in zip(pedals, map(float, pressed), strict=True))
    return steer, gas - brake


def _axis(device: core.InputDevice, axis: core.InputDevice.Axis) -> float:
    found = device.findAxis(axis)
    return found.value if found.known else 0.0
