"""The driver: a telemetry message in, a reply out, whatever goes wrong in between."""

import copy
import math
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from zoo.drive.drive_writer import Scribe
from zoo.drive.notices import Notices
from zoo.drive.session import DrivingPolicy, Session
from zoo.drive.telemetry_message import Telemetry, TelemetryError, decimal_sign, read_telemetry
from zoo.drives.drive_record import FALLBACK, PERSON, DriveRow
from zoo.drives.interventions import OFF_ROAD, STANDSTILL, TAKEOVER, WORDS
from zoo.drives.speed_controller import SpeedController, limit_pedal
from zoo.drives.steering_filter import SteeringFilter
from zoo.drives.tally import LONGEST_STEP_S, Tally, summary_lines

GENTLE_BRAKE = -0.2
PUT_BACK = "put_back"  # in a reply: the speed at which the car is set down on the centre
SILENCE_S = 1.0  # after which another simulator is recorded and shown


@dataclass(frozen=True)
class Reply:
    """An event and its one argument, to be sent; the row of the drive, and the picture, to keep."""

    event: str
    values: dict[str, str]
    row: DriveRow
    picture: bytes | None = None


@dataclass(frozen=True)
class LatestState:
    """How the drive stands, for a page that looks now and then. `frame` is uint8 [160, 320, 3] RGB
    and None before the first; it is the driver's own, not to be changed. `lost` is `off_road` or
    `standstill` while the car is; `put_back`, that the simulator puts it back on the road then;
    `autonomy` None where it is not measured."""

    frame: np.ndarray | None
    steering: float
    throttle: float
    speed_mph: float
    cross_track_m: float | None
    latency_ms: float | None
    clients: int
    telemetry: int
    interventions: int
    off_road: int
    standstills: int
    takeovers: int
    lost: str | None
    put_back: bool
    fallbacks: int
    driven_s: float
    autonomy: float | None
    overridden: bool
    paused: bool
    set_mph: float | None
    recording: bool
    recorded: int
    folder: str
    checkpoint: str
    troubles: dict[str, int]


class Driver:
    """Answers every telemetry once, and keeps count.

    Args:
        policy: what steers.
        controller, steer: copied for each session, since they remember.
        scribe: writes the drive.
        notices: told what goes wrong.
        record: keep the pictures, too.
        checkpoint: where the policy came from, to be shown.
        load: makes a policy of a checkpoint's path, for `switch`.
        margin_m: distance from the centreline that counts as leaving the lane; None is the edge
            line, as the simulator sends it.
        track: name of the track that is driven; None where it is not known.
    """

    def __init__(
        self,
        policy: DrivingPolicy,
        controller: SpeedController,
        steer: SteeringFilter,
        scribe: Scribe,
        notices: Notices,
        record: bool = False,
        checkpoint: str = "",
        load: Callable[[Path], DrivingPolicy] | None = None,
        margin_m: float | None = None,
        track: str | None = None,
    ) -> None:
        self.policy, self.scribe, self.notices = policy, scribe, notices
        self.recording, self.checkpoint, self.load = record, str(checkpoint), load
        self.paused, self.track = False, track
        self.tally = Tally()
        self.sessions: dict[str, Session] = {}
        self.clients = 0  # that ever connected
        self._controller, self._steer, self._margin_m = controller, steer, margin_m
        self._began_s: float | None = None
        self._frame: np.ndarray | None = None
        self._row = DriveRow(0.0)
        self._lead: Session | None = None

    def connect(self, sid: str) -> Session:
        """A simulator has come."""
        self.clients += 1
        controller, steer = copy.deepcopy(self._controller), copy.deepcopy(self._steer)
        self.sessions[sid] = Session(self.clients, controller, steer, self._margin_m)
        self.notices.tell_some("connect", f"simulator {self.clients} has connected")
        return self.sessions[sid]

    def disconnect(self, sid: str) -> None:
        """It has gone."""
        session = self.sessions.pop(sid, None)
        if session is not None:
            self.notices.tell_some("disconnect", f"simulator {session.number} has gone")

    def answer(self, session: Session, data: object, now_s: float | None = None) -> Reply:
        """The one reply to a telemetry's argument, whatever it is; never raises."""
        wall_s = time.perf_counter() if now_s is None else now_s
        now_s = session.now(data, wall_s)
        if self._began_s is None:
            self._began_s = now_s
        elapsed_s, session.last_s = now_s - session.last_s, now_s
        served_s, session.heard_s = wall_s - session.heard_s, wall_s
        judged = session.sends_cross_track
        self.tally.step(elapsed_s, served_s, session.speed_mph, judged)
        if elapsed_s > LONGEST_STEP_S:
            session.rule.restart()
        session.decimal = decimal_sign(data) or session.decimal
        if data is None:
            return self._hand_over(session, now_s)
        session.overridden, lost = False, None
        try:
            telemetry = read_telemetry(data)
            lost = self._judge(session, telemetry, now_s)
            return self._drive(session, telemetry, now_s, lost)
        except TelemetryError as error:
            self.notices.say(error.kind, str(error).removeprefix(f"{error.kind}: "))
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            self.notices.say(
                "the policy failed",
                f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})",
            )
        return self._fall_back(session, now_s, lost is not None)

    def _hand_over(self, session: Session, now_s: float) -> Reply:
        """A person holds a key down, and drives."""
        began = not session.overridden
        if began:
            session.overridden = True
            session.rule.restart()
            session.controller.reset()
            session.steer.reset()
            self.tally.counts[TAKEOVER] += 1
            count = self.tally.interventions
            self.notices.tell_some("person", f"a person drives (intervention {count})")
        row = DriveRow(self._time(now_s), session.number, PERSON, intervention=began)
        return Reply("manual", {}, row)

    def _judge(self, session: Session, telemetry: Telemetry, now_s: float) -> str | None:
        """Return the kind of intervention that a telemetry costs, None for none, and count it."""
        for kind, detail in telemetry.oddities:
            self.notices.say(kind, detail)
        if telemetry.speed_mph is not None:
            session.speed_mph = telemetry.speed_mph
        held = self.paused or session.controller.set_mph == 0
        lost = session.judge(telemetry, now_s, held)
        if lost is not None:
            self.tally.counts[lost] += 1
            line = f"{WORDS[lost]} after {self._time(now_s):.1f} s"
            line += f" (intervention {self.tally.interventions})"
            self.notices.tell_some(lost, line)
        return lost

    def _drive(
        self, session: Session, telemetry: Telemetry, now_s: float, lost: str | None
    ) -> Reply:
        steering, throttle = session.predict(self.policy, telemetry)
        if not math.isfinite(steering):
            raise ValueError(f"it steers by {steering}")
        steering = session.steer(float(steering), now_s)
        throttle = session.controller.throttle(session.speed_mph, steering, throttle, now_s)
        if not math.isfinite(throttle):
            raise ValueError(f"its throttle is {throttle}")
        session.steering = steering
        if self.paused:
            throttle = GENTLE_BRAKE
        throttle = limit_pedal(throttle, session.speed_mph)
        row = DriveRow(
            time_s=self._time(now_s),
            client=session.number,
            steering=steering,
            throttle=throttle,
            speed_mph=session.speed_mph,
            cross_track_m=telemetry.cross_track_m,
            intervention=lost is not None,
        )
        leads = self._leads(session)
        if leads:
            self._frame = telemetry.frame
        # Rows of several cars in one recording would be of no use to train on.
        picture = telemetry.picture if self.recording and leads else None
        values = reply_values(steering, throttle, session.decimal or ".")
        if lost is not None and session.can_put_back:
            values |= self._put_back(session)
        return Reply("steer", values, row, picture)

    def _put_back(self, session: Session) -> dict[str, str]:
        """Have the simulator put the car back on the centre, at the speed to hold."""
        session.controller.reset()
        session.steer.reset()
        mph = session.controller.set_mph or session.speed_mph
        return {PUT_BACK: number_text(mph, session.decimal or ".")}

    def _leads(self, session: Session) -> bool:
        """Whether this is the session that is recorded and shown: the first, while it drives."""
        lead = self._lead
        if lead is None or session.heard_s - lead.heard_s > SILENCE_S:
            self._lead = session
        return self._lead is session

    def _fall_back(self, session: Session, now_s: float, lost: bool) -> Reply:
        """Something is wrong: steer as before, brake gently."""
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
            # It has not driven yet; and whole numbers are read alike in every locale.
            return Reply("steer", {"steering_angle": "0", "throttle": "0"}, row)
        return Reply("steer", reply_values(session.steering, throttle, session.decimal), row)

    def sent(self, reply: Reply, latency_ms: float) -> None:
        """The reply is on its way; now there is time to keep what it was."""
        self.tally.latency.add(latency_ms)
        row = replace(reply.row, latency_ms=latency_ms)
        if self._lead is None or row.client == self._lead.number:
            self._row = row
        self.scribe.put(row, reply.picture)

    def _time(self, now_s: float) -> float:
        return now_s - self._began_s

    def end(self, began: datetime) -> Path | None:
        """Write the drive and print its figures; return its folder, None without a frame."""
        figures = self.tally.figures() | {
            "track": self.track,
            "checkpoint": self.checkpoint,
            "began": began.isoformat(timespec="seconds"),
            "clients": self.clients,
            "set_mph": self.set_mph,
            "troubles": dict(self.notices.counts),
        }
        written = self.scribe.close(figures)
        for line in [*self.notices.count_lines(), *summary_lines(figures)]:
            self.notices.tell(line)
        return self.scribe.folder if written else None

    # What a page's buttons do.

    @property
    def set_mph(self) -> float | None:
        """The speed to hold; None with a controller that holds none."""
        return self._controller.set_mph

    def set_speed(self, set_mph: float) -> None:
        """Change the speed to hold, of all sessions; raises ValueError if that cannot be."""
        if self.set_mph is None:
            raise ValueError("this drive.speed holds no speed; drive with drive.speed=pi")
        if not (math.isfinite(set_mph) and 0 <= set_mph <= 100):
            raise ValueError(f"{set_mph} mph is not in 0..100")
        for controller in (self._controller, *(one.controller for one in self.sessions.values())):
            controller.set_mph = float(set_mph)

    def switch(self, path: Path | str) -> None:
        """Drive with another checkpoint from the next frame on; the old one stays if it does not
        load. Takes as long as loading: call it in a thread.

        Raises:
            InputError: see `zoo.checkpoints.policy.load_policy`.
        """
        policy = self.load(Path(path))
        self.policy, self.checkpoint = policy, str(path)

    def latest(self) -> LatestState:
        """How the drive stands now; costs a few microseconds."""
        row, tally, lead = self._row, self.tally, self._lead
        return LatestState(
            frame=self._frame,
            steering=row.steering,
            throttle=row.throttle,
            speed_mph=row.speed_mph if math.isfinite(row.speed_mph) else 0.0,
            cross_track_m=row.cross_track_m if math.isfinite(row.cross_track_m) else None,
            latency_ms=row.latency_ms if math.isfinite(row.latency_ms) else None,
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
            autonomy=tally.autonomy if math.isfinite(tally.autonomy) else None,
            overridden=any(one.overridden for one in self.sessions.values()),
            paused=self.paused,
            set_mph=self.set_mph,
            recording=self.recording,
            recorded=self.scribe.recorded,
            folder=str(self.scribe.folder),
            checkpoint=self.checkpoint,
            troubles=dict(self.notices.counts),
        )


def reply_values(steering: float, throttle: float, decimal: str) -> dict[str, str]:
    """A `steer` event's argument, numbers as the client itself writes them.

    >>> reply_values(0.05, 0.2, ",")
    {'steering_angle': '0,0500', 'throttle': '0,2000'}
    """
    pair = {"steering_angle": steering, "throttle": throttle}
    return {name: number_text(value, decimal) for name, value in pair.items()}


def number_text(value: float, decimal: str) -> str:
    """A number with four decimals, as the client writes it."""
    return f"{value:.4f}".replace(".", decimal)
