"""From keys, mouse and gamepad to steering and throttle."""

import time
from pathlib import Path

import numpy as np
import pytest

from tests.zoo.server.browser import Browser, needs_chromium
from zoo.simulator.hand_control import HandControl, Hands
from zoo.simulator.hand_page import served_seat

STEP_S = 0.02


def after(seconds: float, hands: Hands, control: HandControl | None = None) -> HandControl:
    control = control or HandControl()
    for _ in range(round(seconds / STEP_S)):
        control.step(STEP_S, hands)
    return control


@pytest.mark.parametrize(
    ("keys", "way"),
    [({"arrow_left"}, -1), ({"a"}, -1), ({"arrow_right"}, 1), ({"d"}, 1), ({"a", "d"}, 0)],
    ids=lambda value: "+".join(sorted(value)) if isinstance(value, set) else str(value),
)
def test_steering_builds_up_while_a_key_is_held(keys, way):
    assert after(0.2, Hands(keys)).steering == pytest.approx(0.5 * way)
    assert after(2, Hands(keys)).steering == way


def test_steering_returns_when_the_key_is_released():
    control = after(0.2, Hands({"a"}))
    assert after(0.1, Hands(), control).steering == pytest.approx(-0.2)
    assert after(0.1, Hands(), control).steering == 0


@pytest.mark.parametrize("keys", [{"arrow_up"}, {"w"}])
def test_up_accelerates_and_down_brakes_at_once(keys):
    control = after(1, Hands(keys))
    assert control.throttle == 1
    assert after(STEP_S, Hands({"s"}), control).throttle == pytest.approx(-0.06)
    assert after(1, Hands({"arrow_down"}), control).throttle == -1
    assert after(1, Hands(), control).throttle == 0


def test_steps_of_another_length_give_the_same_steering():
    coarse = HandControl()
    for _ in range(2):
        coarse.step(0.1, Hands({"a", "w"}))
    fine = after(0.2, Hands({"a", "w"}))
    assert (coarse.steering, coarse.throttle) == pytest.approx((fine.steering, fine.throttle))


@pytest.mark.parametrize(
    ("moved", "steering"), [(0.0, 0), (-0.1, -0.15), (1 / 3, 0.5), (0.7, 1), (-0.9, -1)]
)
def test_the_mouse_steers_by_how_far_it_went_since_the_button_was_pressed(moved, steering):
    control = after(STEP_S, Hands({"mouse1"}, pointer=0.3))
    assert control.steering == 0
    control = after(STEP_S, Hands({"mouse1"}, pointer=0.3 + moved), control)
    assert control.steering == pytest.approx(steering)


def test_a_mouse_steers_only_with_its_button_and_each_press_begins_at_zero():
    control = after(STEP_S, Hands(pointer=0.9))
    assert control.steering == 0
    after(STEP_S, Hands({"mouse1"}, pointer=0.2), control)
    after(STEP_S, Hands({"mouse1"}, pointer=0.4), control)
    assert control.steering == pytest.approx(0.3)
    assert after(0.2, Hands(pointer=0.4), control).steering == 0
    assert after(STEP_S, Hands({"mouse1"}, pointer=0.4), control).steering == 0


def test_keys_come_before_the_mouse_and_may_accelerate_while_it_steers():
    control = after(STEP_S, Hands({"mouse1"}, pointer=0.5))
    assert after(1, Hands({"mouse1", "a"}, pointer=0.9), control).steering == -1
    after(STEP_S, Hands({"mouse1", "w"}), control := HandControl())
    after(1, Hands({"mouse1", "w"}, pointer=0.7), control)
    assert (control.steering, control.throttle) == pytest.approx((0.3, 1))


def test_a_stick_steers_beyond_its_dead_zone_and_triggers_accelerate_and_brake():
    sticks = (0.08, -0.1, 0.55, -1, 1)
    steering = [after(STEP_S, Hands(stick=stick)).steering for stick in sticks]
    assert steering == pytest.approx([0, 0, 0.5, -1, 1])
    throttles = [after(STEP_S, Hands(pedals=pedals)).throttle for pedals in (0.4, -1)]
    assert throttles == pytest.approx([0.4, -1])


@pytest.mark.parametrize("brake", [Hands({"s"}), Hands(pedals=-0.5)], ids=["key", "trigger"])
def test_cruising_holds_the_throttle_until_braking(brake):
    control = HandControl()
    control.cruising = True
    assert after(5, Hands({"a"}), control).throttle == pytest.approx(0.4)
    assert after(STEP_S, brake, control).throttle < 0
    assert after(1, Hands(), control).throttle == 0


@needs_chromium
def test_a_second_page_takes_the_wheel_with_its_first_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines: list[str] = []
    with served_seat(lines.append) as seat, Browser(tmp_path, 800, 600) as browser:
        taken: list[Hands] = []
        monkeypatch.setattr(seat, "take", lambda name, value: taken.append(value))
        url = lines[0].split()[1]
        browser.open(url)
        browser.wait_for("document.querySelector('.stage') !== null")
        for event in ("Event('blur')", "KeyboardEvent('keydown', {code: 'KeyD'})"):
            browser.value(f"dispatchEvent(new {event})")
        browser.open(url)  # lets go of the key
        end = time.monotonic() + 15
        while len(taken) < 2 and time.monotonic() < end:
            time.sleep(0.05)
        assert taken == [Hands(frozenset({"d"})), Hands()]
        seat.show_until_ended(np.zeros((160, 320, 3), np.uint8))
        browser.wait_for("document.querySelector('.keys').hidden")
        parts = "[...document.querySelectorAll('button:not([hidden])')].map(one => one.title)"
        assert [title for title in browser.value(parts) if title] == ["Esc"], "nobody drives"
