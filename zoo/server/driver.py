"""The driver: it answers every telemetry message, whatever fails."""

import copy
import math
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from itertools import chain
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from zoo.base.errors import InputError
from zoo.base.notices import Notices
from zoo.checkpoints.policy_base import Policy, PolicyFunction, as_policy
from zoo.driving.drive_record import FALLBACK, PERSON, DriveRow
from zoo.driving.interventions import OFF_ROAD, STANDSTILL, TAKEOVER, WORDS
from zoo.driving.speed_controller import SpeedController, SteeringFilter, limit_pedal
from zoo.driving.tally import LONGEST_STEP_S, Tally, summary_lines
from zoo.runs.result_table import known
from zoo.server.drive_writer import BackgroundWriter
from zoo.server.session import Session
from zoo.server.telemetry_message import (
    PUT_BACK,
    Reply,
    Telemetry,
    TelemetryError,
    decimal_sign,
    number_text,
    read_telemetry,
    reply_values,
)

GENTLE_BRAKE = -0.2
SILENCE_S = 1.0  # silence of a simulator after which another one is recorded and shown


class Driver:
    """Driver that answers every telemetry once, and counts interventions and latency.

    Args:
        policy: policy that steers.
        controller: speed controller, copied for each session.
        steer: steering filter, copied for each session.
        writer: writer of the drive.
        notices: log of troubles.
        record: whether to record images.
        checkpoint: path of the policy's checkpoint, for the page and `drive.json`.
        load: function that loads a policy from a checkpoint's path, for `switch`.
        margin_m: distance from the centreline in metres above which the car has left the lane; None
            for the edge line, as the simulator sends it.
        track: name of the first simulator's track; None if unknown.
    """

    def __init__(
        self,
        policy: Policy | PolicyFunction,
        controller: SpeedController,
        steer: SteeringFilter,
        writer: BackgroundWriter,
        notices: Notices,
        record: bool = False,
        checkpoint: str = "",
        load: Callable[[Path], Policy] | None = None,
        margin_m: float | None = None,
        track: str | None = None,
    ) -> None:
        self.policy, self.writer, self.notices = as_policy(policy), writer, notices
        self.recording, self.checkpoint, self.load = record, str(checkpoint), load
        self.paused, self.track = False, track
        self.tally = Tally()
        self.sessions: dict[str, Session] = {}
        self.clients = 0  # number of simulators that have connected so far
        self._controller, self._steer, self._margin_m = controller, steer, margin_m
        self._engines: dict[str, list[dict]] = {}  # of each checkpoint that drove, in their order
        self._began_s: float | None = None
        self._frame: np.ndarray | None = None
        self._lap: float | None = None
        self._xy: tuple[float, float] | None = None
        self._row = DriveRow(0.0)
        self._lead: Session | None = None

    def connect(self, sid: str) -> Session:
        """Add a session for a simulator that connected."""
        self.clients += 1
        controller, steer = copy.deepcopy(self._controller), copy.deepcopy(self._steer)
        self.sessions[sid] = Session(self.clients, controller, steer, self._margin_m)
        self.notices.print_some("connect", f"simulator {self.clients} has connected")
        return self.sessions[sid]

    def disconnect(self, sid: str) -> None:
        """Remove the session of a simulator that disconnected."""
        session = self.sessions.pop(sid, None)
        if session is not None:
            self.notices.print_some("disconnect", f"simulator {session.number} has disconnected")

    def answer(self, session: Session, data: object, now_s: float | None = None) -> Reply:
        """Return the reply to a telemetry; never raise.

        Args:
            session: session of the simulator.
            data: argument of the telemetry event, of any type.
            now_s: time in seconds; None for the wall clock.
        """
        wall_s = time.perf_counter() if now_s is None else now_s
        now_s = session.now(data, wall_s)
        self._began_s = now_s if self._began_s is None else self._began_s
        elapsed_s, session.last_s = now_s - session.last_s, now_s
        served_s, session.heard_s = wall_s - session.heard_s, wall_s
        self.tally.step(elapsed_s, served_s, session.speed_mph, session.sends_cross_track)
        if elapsed_s > LONGEST_STEP_S:
            session.rule.restart()
        session.decimal = decimal_sign(data) or session.decimal
        if data is None:
            return self._hand_over(session, now_s)
        session.overridden, lost = False, None
        try:
            if elapsed_s > LONGEST_STEP_S:
                session.forget()
            telemetry = read_telemetry(data)
            lost = self._judge(session, telemetry, now_s)
            return self._drive(session, telemetry, now_s, lost)
        except TelemetryError as error:
            self.notices.report(error.kind, error.detail)
        except Exception as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            self.notices.report(
                "the policy failed",
                f"{type(error).__name__}: {error} ({Path(frame.filename).name}:{frame.lineno})",
            )
        return self._fall_back(session, now_s, lost is not None)

    def _hand_over(self, session: Session, now_s: float) -> Reply:
        """Return the reply while a person drives by the keys of the simulator."""
        began = not session.overridden
        if began:
            session.overridden = True
            session.rule.restart()
            session.restart()
            self.tally.counts[TAKEOVER] += 1
            count = self.tally.interventions
            self.notices.print_some("person", f"a person drives (intervention {count})")
        row = DriveRow(self._time(now_s), session.number, PERSON, intervention=began)
        return Reply("manual", {}, row)

    def _judge(self, session: Session, telemetry: Telemetry, now_s: float) -> str | None:
        """Count the intervention that a telemetry shows; return its kind, None for none."""
        for kind, detail in telemetry.oddities:
            self.notices.report(kind, detail)
        mph = session.speed_mph = telemetry.speed_mph
        session.seen_mph = session.seen_mph if math.isnan(mph) else mph
        lost = session.judge(telemetry, now_s, self.paused or session.controller.set_mph == 0)
        if lost is not None:
            self.tally.counts[lost] += 1
            line = f"{WORDS[lost]} after {self._time(now_s):.1f} s"
            line += f" (intervention {self.tally.interventions})"
            self.notices.print_some(lost, line)
        return lost

    def _check_shape(self, height: int, width: int) -> None:
        """Report frames that are wider or narrower than the training's: the view stretches them."""
        view = self.policy.members[0].view
        if view is not None and height * view.frame[1] != width * view.frame[0]:
            trained = "{1} x {0}".format(*view.frame)
            detail = f"{width} x {height}, the training's are {trained}; the view is stretched"
            self.notices.report("frames of another shape than the training's", detail)

    def _drive(
        self, session: Session, telemetry: Telemetry, now_s: float, lost: str | None
    ) -> Reply:
        if self.checkpoint not in self._engines:
            engines = (member.engine for member in self.policy.members)
            self._engines[self.checkpoint] = [dict(facts) for facts in engines if facts]
        self._check_shape(*telemetry.frame.shape[:2])
        command = session.predict(self.policy.in_car(self.writer.rig), telemetry, now_s)
        if not math.isfinite(command.steering) or not math.isfinite(command.throttle or 0.0):
            raise ValueError(f"its steering is {command.steering}, its throttle {command.throttle}")
        steering = session.steer(float(command.steering), now_s)
        command = replace(command, steering=steering)
        throttle = session.controller.pedal(command, session.speed_mph, now_s)
        session.send(steering)
        if self.paused:
            throttle = limit_pedal(GENTLE_BRAKE, session.speed_mph)
        row = DriveRow(
            time_s=self._time(now_s),
            client=session.number,
            steering=steering,
            throttle=throttle,
            speed_mph=session.speed_mph,
            cross_track_m=telemetry.cross_track_m,
            intervention=lost is not None,
            spread=math.nan if command.spread is None else command.spread,
        )
        leads = self._leads(session)
        if leads:
            self._frame, self._lap, self._xy = telemetry.frame, telemetry.lap, telemetry.xy
        # Another frame of the old place may be under way when the car is put back.
        waits = session.can_put_back and session.rule.state is not None
        # A recording with rows of several cars is useless for training.
        is_recorded = self.recording and leads and (lost is not None or not waits)
        image = telemetry.image if is_recorded else None
        values = reply_values(steering, throttle, session.decimal or ".")
        begins, session.begins = session.begins, False
        if waits:
            session.restart()
            if lost is not None:  # the simulator puts the car back at this speed
                mph = session.controller.set_mph or session.seen_mph
                values[PUT_BACK] = number_text(mph, session.decimal or ".")
        return Reply("steer", values, row, image, begins)

    def _leads(self, session: Session) -> bool:
        """Return whether a session is the one to record and show: the first one that drives."""
        lead = self._lead
        if lead is None or session.heard_s - lead.heard_s > SILENCE_S:
            self._lead, session.begins = session, True
        return self._lead is session

    def _fall_back(self, session: Session, now_s: float, lost: bool) -> Reply:
        """Return the reply after an error: the last steering, and a gentle brake."""
        self.tally.fallbacks += 1
        throttle = limit_pedal(GENTLE_BRAKE, session.speed_mph)
        row = DriveRow(
            time_s=self._time(now_s),
            client=session.number,
            driver=FALLBACK,
            steering=session.steering,
            throttle=throttle,
            intervention=lost,
        )
        if session.decimal is None:
            # The decimal sign is unknown; integers are the same in every locale.
            return Reply("steer", {"steering_angle": "0", "throttle": "0"}, row)
        return Reply("steer", reply_values(session.steering, throttle, session.decimal), row)

    def sent(self, reply: Reply, latency_ms: float) -> None:
        """Count and record a reply that was sent."""
        self.tally.latency.add(latency_ms)
        row = replace(reply.row, latency_ms=latency_ms)
        if self._lead is None or row.client == self._lead.number:
            self._row = row
        self.writer.put(row, reply.image, reply.begins)

    def _time(self, now_s: float) -> float:
        return now_s - (now_s if self._began_s is None else self._began_s)

    def end(self, began: datetime) -> Path | None:
        """Write `drive.json` and print the summary; return the folder, None without a frame."""
        figures = self.tally.figures() | {
            "track": self.track if self.clients == 1 else None,
            "checkpoint": ", ".join(self._engines) or self.checkpoint,
            "engines": list(chain.from_iterable(self._engines.values())),
            "began": began.isoformat(timespec="seconds"),
            "clients": self.clients,
            "set_mph": self.set_mph,
            "troubles": dict(self.notices.counts),
        }
        written = self.writer.close(figures)
        for line in [*self.notices.count_lines(), *summary_lines(figures)]:
            self.notices.print(line)
        return self.writer.folder if written else None

    # Commands of the live page.

    @property
    def set_mph(self) -> float | None:
        """Return the speed to hold; None if the controller holds none."""
        return self._controller.set_mph

    def set_speed(self, set_mph: float) -> None:
        """Change the speed to hold of all sessions.

        Raises:
            ValueError: the controller holds no speed, or the speed is out of range.
        """
        if self.set_mph is None:
            raise ValueError("this speed= holds no speed; restart with speed=pi")
        if not (math.isfinite(set_mph) and 0 <= set_mph <= 100):
            raise ValueError(f"set_mph={set_mph}: must be in 0..100")
        controllers = [session.controller for session in self.sessions.values()]
        for controller in (self._controller, *controllers):
            controller.set_mph = float(set_mph)

    def switch(self, path: Path | str) -> None:
        """Load another checkpoint and drive with it from the next frame on.

        Loading takes seconds, so call this in a thread. The policy is kept if loading fails.

        Raises:
            InputError: see `zoo.checkpoints.checkpoint_policy.load_policy`.
        """
        if self.load is None:
            raise InputError(f"{path}: this server loads no checkpoint")
        self.policy, self.checkpoint = as_policy(self.load(Path(path))), str(path)

    def latest(self) -> SimpleNamespace:
        """Return the present state of the drive for the live page; None for unknown values.

        `frame` is the latest frame, uint8 [H, W, 3] RGB, which must not be changed; `lost` is
        `off_road` or `standstill` while the car is in that state.
        """
        row, tally, lead = self._row, self.tally, self._lead
        return SimpleNamespace(
            frame=self._frame,
            lap=self._lap,
            xy=self._xy,
            steering=row.steering,
            steering_deg=self.writer.rig and self.writer.rig.steering_deg,
            spread=known(row.spread),
            throttle=row.throttle,
            speed_mph=known(row.speed_mph) or 0.0,
            cross_track_m=known(row.cross_track_m),
            latency_ms=known(row.latency_ms),
            clients=len(self.sessions),
            telemetry=tally.telemetry,
            interventions=tally.interventions,
            off_road=tally.counts[OFF_ROAD],
            standstills=tally.counts[STANDSTILL],
            takeovers=tally.counts[TAKEOVER],
            lost=lead.rule.state if lead else None,
            put_back=lead.can_put_back if lead else False,
            fallbacks=tally.fallbacks,
            driven_s=tally.driven_s,
            autonomy=known(tally.autonomy),
            overridden=any(session.overridden for session in self.sessions.values()),
            paused=self.paused,
            set_mph=self.set_mph,
            recording=self.recording,
            recorded=self.writer.recorded,
            folder=str(self.writer.folder),
            checkpoint=self.checkpoint,
            troubles=dict(self.notices.counts),
        )
