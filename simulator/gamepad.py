"""Gamepads and steering wheels known to Panda3D; users may plug them in at any time."""

from panda3d import core

Axis, Kind = core.InputDevice.Axis, core.InputDevice.DeviceClass
# For each kind of device: the axes of steering, accelerator and brake.
AXES = {
    Kind.gamepad: (Axis.left_x, Axis.right_trigger, Axis.left_trigger),
    Kind.steering_wheel: (Axis.wheel, Axis.accelerator, Axis.brake),
}
TRIGGERS = (core.GamepadButton.rtrigger(), core.GamepadButton.ltrigger())


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
