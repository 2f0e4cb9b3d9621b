"""Turns scenes into one validated history per person, and reports faults of the input."""

import threading
from collections import Counter

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.scene import Doubt, Scene
from hri_predict.contracts.source import SourceSettings
from hri_predict.people.body.body_model import body_model
from hri_predict.people.body.canonical import Mapped, canonical_bodies, canonical_body
from hri_predict.people.body.floor_watch import FloorWatch
from hri_predict.people.body.inferred import Inference
from hri_predict.people.body.made_up import MadeUpWatch, Sign
from hri_predict.people.body.posture_watch import PostureWatch
from hri_predict.people.body.size_watch import SizeWatch
from hri_predict.people.clock.scene_gate import SceneGate
from hri_predict.people.inferring import with_inferred
from hri_predict.people.joined import join
from hri_predict.people.lost.floor import standing_in
from hri_predict.people.lost.free_space import free_space_of
from hri_predict.people.lost.lost_people import LostPeople
from hri_predict.people.lost.remembered import RemembersLost
from hri_predict.people.lost.unplaced import Unplaced, Why
from hri_predict.people.recent import recent_captures
from hri_predict.people.ring_buffer import NEVER, PushResult, RingBuffer
from hri_predict.people.roster import SAME_PLACE_M, Appearing, Roster
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.snapshot import PeopleSnapshot, distinct
from hri_predict.people.track import Body, MotionLimits, Track
from hri_predict.protocol.reasons import Reason

ELSEWHERE_M = 2.5
"""Distance from its id's track at which a body in a refused scene is a different body."""


class People(RemembersLost):
    """Tracks all people through the scenes of one source.

    Call ``receive`` in one thread and ``snapshot`` in another; both are short. A scene is *good* if
    its sequence and capture time advance, the source saw the room, and every body in it was
    accepted and tracked. A person without a visible joint must have been tracked before. Only good
    scenes count as captures and keep the input fresh.

    Args:
        settings: see ``PeopleSettings``.
        joint_map: map from the source's joints to canonical joints.
        source_settings: provides ``min_latency_s``, ``stale_s`` and the behaviour of the clock.
        rate_hz_source: nominal scenes per second.
        declares_noise: whether bit-identical joints indicate a frozen sensor.
        history_steps: T, steps of history in a snapshot.
        rate_hz_predictor: steps per second of that history.
    """

    def __init__(
        self,
        *,
        settings: PeopleSettings,
        joint_map: JointMap,
        source_settings: SourceSettings,
        rate_hz_source: float,
        declares_noise: bool,
        history_steps: int,
        rate_hz_predictor: float,
    ) -> None:
        period_s = 1.0 / rate_hz_source
        gap_s = settings.max_gap_s or max(0.1, 2.5 * period_s)
        span_s = history_steps / rate_hz_predictor + gap_s
        self.stale_ns = round(source_settings.stale_after_s(rate_hz_source) * 1e9)
        self._settings = settings
        self._joint_map = joint_map
        self._origin: Floats = np.asarray(source_settings.room_from_source.xyz, np.float64)
        self._inference = Inference(body_model(), settings.floor_m)
        self._declares_noise = declares_noise
        self._steps = history_steps
        self._rate_hz = rate_hz_predictor
        self._gap_ns = gap_ns = round(gap_s * 1e9)
        self._capacity = int(1.25 * span_s * rate_hz_source) + 16
        self._limits = MotionLimits(
            settings.max_joint_speed_m_s,
            settings.max_body_speed_m_s,
            period_ns=round(period_s * 1e9),
            refused_ns=self._gap_ns,
        )
        self._gate = SceneGate(
            round(period_s * 1e9),
            round(source_settings.min_latency_s * 1e9),
            clock_wander_ns=round(source_settings.clock_wander_s * 1e9),
            even_captures=source_settings.even_captures,
            stamps_are_ours=source_settings.stamps_are_ours,
        )
        self._lock = threading.Lock()
        self._roster = Roster(
            settings=settings,
            keeps_ids=source_settings.keeps_ids,
            lost=LostPeople(settings, free_space_of(settings, source_settings)),
            limits=self._limits,
            gap_ns=self._gap_ns,
            history=self._history,
        )
        self._tracks, self._lost = self._roster.tracks, self._roster.lost
        self._counters: Counter[str] = self._roster.counters
        self._posture = PostureWatch(settings, source_settings.field_of_view)
        self._made_up = MadeUpWatch(settings, self._origin, round(period_s * 1e9))
        self._floor, self._size = FloorWatch(settings), SizeWatch(settings)
        self._judged_before = source_settings.judges_bodies
        self._signs: set[Sign] = set()
        self._hip_centred: set[int] = set()
        self._now_ns, self._captures = NEVER, 0
        self._receipt_ns: int | None = None
        self._newest_good_ns: int | None = None
        self._unplaced = Unplaced(gap_ns, settings.reaccept_captures, source_settings.keeps_ids)
        self._blind = self._impossible = self._misplaced = self._coasts = False
        self._doubts: tuple[Doubt, ...] = ()
        self._recalled, self._has_recalled = [], False

    # -- in ---------------------------------------------------------------------------------------

    def receive(self, scene: Scene, receipt_ns: int) -> None:
        """Process one scene received at ``receipt_ns`` (node's clock). Never raises."""
        with self._lock:
            self._now_ns = max(self._now_ns, receipt_ns)
            self._take_recalled(receipt_ns)
            self._receipt_ns = receipt_ns
            capture_ns = self._gate.admit(scene, receipt_ns)
            if capture_ns is not None:
                self._take(scene, capture_ns, receipt_ns)
            elif self._gate.capture_ns != NEVER:
                self._look_at_refused(scene)

    def _take(self, scene: Scene, capture_ns: int, now_ns: int) -> None:
        """Track all people in a scene that advances."""
        self._blind = not scene.sees_room
        self._counters["blind_scenes"] += self._blind
        self._impossible = self._misplaced = self._coasts = False
        self._signs.clear()
        frozen = False
        starts: list[Appearing] = []
        seen: dict[int, Body | None] = {}
        people = self._made_up.known_first(scene.people)
        bodies = canonical_bodies(people, self._joint_map, self._origin)
        postures = self._posture.due((m.body for m in bodies if m.body is not None), capture_ns)
        for person, mapped in zip(people, bodies, strict=True):
            if person.id in seen:
                self._refuse_second(mapped.body, seen[person.id], capture_ns)
                continue
            self._count(mapped, person.id)
            body = seen[person.id] = mapped.body
            if body is None:
                continue
            self._roster.part(body, capture_ns)
            track = self._tracks.get(person.id)
            if track is None and len(starts) >= self._settings.max_people:
                self._counters["excess_people"] += 1
                self._unplaced.note(Why.ONE_TOO_MANY, person.id, capture_ns)
                continue
            wrong = self._posture.judge(body, capture_ns, postures.get(body.id))
            if wrong is not None:
                self._counters[wrong.value] += 1
                self._misplaced = True  # still tracked, because somebody is there
            if self._size.is_wrong(body, capture_ns):
                self._refuse("wrong_size_bodies")  # tracked likewise
            if not self._judged_before:
                self._floor.note(body, capture_ns)
                self._note_made_up(body, capture_ns)
            if track is None:
                starts.append((body, None))
            elif self._is_repeat(track, body, capture_ns):
                frozen = True
            elif (risen := self._follow(track, body, capture_ns, now_ns)) is not None:
                starts.append((body, risen))
        nowhere = [number for number, body in seen.items() if body is None]
        for refused in self._roster.begin(starts, capture_ns, now_ns, unseen=nowhere):
            self._unplaced.note(Why.ONE_TOO_MANY, refused, capture_ns)
        self._note_unlocated(nowhere, capture_ns)
        join(self._roster, scene.joined, capture_ns)
        if scene.sees_room:
            self._roster.expire(capture_ns)
            vanished = self._unplaced.update(self._tracks, capture_ns)
            self._counters["vanished_untracked"] += len(vanished)
            self._lost.lose_places(vanished)
        # a rival track: the id is in one of two places, and it is not known in which
        self._impossible |= any(track.rival is not None for track in self._tracks.values())
        self._counters["unjudged_bodies"] = self._posture.unjudged
        self._doubts = (*scene.doubts, *self._floor.doubts())
        self._counters.update(doubt.reason.name.lower() for doubt in self._doubts)
        bad = self._impossible or self._misplaced or frozen or self._coasts or bool(self._unplaced)
        bad |= bool(self._signs) or bool(self._doubts)
        if scene.sees_room and not bad:
            self._newest_good_ns = capture_ns
            self._captures += 1
        here = [track.centroid for track in self._tracks.values()]
        inexact = any(track.error_m > 0 for track in self._tracks.values())
        is_whole = scene.sees_room and not bad and not nowhere and not inexact
        standing = standing_in(self._tracks.values(), capture_ns)
        self._counters["seen_free"] += self._lost.see(capture_ns, here, is_whole, standing)

    def _note_made_up(self, body: Body, capture_ns: int) -> None:
        sign = self._made_up.judge(body, capture_ns, body.id in self._hip_centred)
        if sign is not None:
            self._counters[sign.value] += 1
            self._signs.add(sign)

    def _refuse(self, why: str) -> None:
        self._counters[why] += 1
        self._impossible = True

    def _refuse_second(self, body: Body | None, first: Body | None, capture_ns: int) -> None:
        """Refuse a second body with one id: it is another person, unless it is a repeat."""
        self._refuse("duplicate_ids")
        if body is None:
            return
        if first is None or np.linalg.norm(body.centroid - first.centroid) > SAME_PLACE_M:
            self._unplaced.note(Why.SECOND_BODY, body.id, capture_ns)

    def _look_at_refused(self, scene: Scene) -> None:
        """Check a scene that does not advance: it changes no track, but may show another person.

        Late and repeated packets show tracked people near their positions. Other bodies indicate
        two senders, or a scene that is sent in parts.
        """
        capture_ns = self._gate.capture_ns
        for person in scene.people:
            track = self._tracks.get(person.id)
            if track is None:
                if not self._roster.ended_lately(person.id, capture_ns):
                    self._counters["people_in_refused_scenes"] += 1
                    self._unplaced.note(Why.REFUSED_SCENE, person.id, capture_ns)
                continue
            body = canonical_body(person, self._joint_map, self._origin).body
            if body is not None and np.linalg.norm(body.centroid - track.centroid) > ELSEWHERE_M:
                self._counters["people_in_refused_scenes"] += 1
                self._unplaced.note(Why.REFUSED_ELSEWHERE, person.id, capture_ns)

    def _note_unlocated(self, ids: list[int], capture_ns: int) -> None:
        """Record people without a visible joint who are neither tracked nor lost.

        A tracked person is assumed where they were last seen, a lost person in the lost zone. Any
        other person is at an unknown place in the room.
        """
        for number in ids:
            if number in self._tracks or self._roster.still_lost(number, capture_ns):
                continue
            self._counters["unlocated_people"] += 1
            if self._roster.still_ended(number, capture_ns):
                self._coasts = True  # the tracker shows the id of somebody who left or was renamed
            else:
                self._unplaced.note(Why.NO_JOINT, number, capture_ns)

    def _count(self, mapped: Mapped, number: int) -> None:
        (self._hip_centred.add if mapped.hip_centred else self._hip_centred.discard)(number)
        self._counters.update(mapped.counts)
        if mapped.trouble is not None:
            self._refuse(mapped.trouble)

    def _is_repeat(self, track: Track, body: Body, capture_ns: int) -> bool:
        """Return whether a source that declares noise repeated identical joints."""
        if not (self._declares_noise and track.has_shown(body)):
            return False
        track.present_ns = capture_ns
        track.repeats += 1
        self._counters["identical_captures"] += 1
        return True

    def _follow(self, track: Track, body: Body, capture_ns: int, now_ns: int) -> Track | None:
        """Append ``body`` to its track if it is plausible.

        Returns:
            the rival track, if captures that contradict this track have agreed for long enough.
        """
        rival = track.rival
        believed = track.believable(body, capture_ns, self._limits)
        if believed is not None and self._roster.continues(track, body, capture_ns):
            glitches = np.count_nonzero(body.observed) - np.count_nonzero(believed)
            self._counters["impossible_joints"] += int(glitches)
            self._push(
                track=track, body=body, believed=believed, capture_ns=capture_ns, now_ns=now_ns
            )
            self._roster.drop_rival(track, rival)
            return None
        self._refuse("impossible_captures")
        track.present_ns = capture_ns
        track.repeats = 0
        agrees = rival.believable(body, capture_ns, self._limits) if rival else None
        if rival is None or agrees is None:
            track.rival = self._roster.start(body, capture_ns, now_ns)
            self._roster.drop_rival(track, rival)
            return None
        self._push(track=rival, body=body, believed=agrees, capture_ns=capture_ns, now_ns=now_ns)
        if rival.captures < self._settings.reaccept_captures:
            return None
        track.rival = None
        return rival

    def _push(
        self, *, track: Track, body: Body, believed: Bools, capture_ns: int, now_ns: int
    ) -> None:
        result = self._roster.push(
            track=track, body=body, believed=believed, capture_ns=capture_ns, now_ns=now_ns
        )
        if result is not PushResult.ACCEPTED:
            self._refuse(f"push_{result.value}")

    def _history(self) -> RingBuffer:
        return RingBuffer(
            joints=len(JOINTS),
            capacity=self._capacity,
            max_gap_ns=self._gap_ns,
            future_tolerance_ns=round(self._settings.future_tolerance_s * 1e9),
        )

    # -- out --------------------------------------------------------------------------------------

    def acknowledge(self) -> int:
        """Remove the lost people counted in the newest snapshot, as confirmed by an operator;
        return their number.
        """
        with self._lock:
            forgotten = self._lost.acknowledge()
            self._counters["acknowledged"] += 1
            self._counters["forgotten"] += forgotten
            return forgotten

    def counters(self) -> dict[str, int]:
        """Return the counters of all scenes so far; those of a snapshot end with its time."""
        with self._lock:
            return {**self._gate.counts(), **self._counters}

    def snapshot(self, now_ns: int) -> PeopleSnapshot:
        """Return all people at ``now_ns`` (node's clock), and the faults of the input."""
        with self._lock:
            self._now_ns = max(self._now_ns, now_ns)
            self._take_recalled(now_ns)
            tracks = [(t.id, t.history, t.capture_ns, t.error_m) for t in self._tracks.values()]
            lost, to_acknowledge = self._lost.snapshot(), self._lost.to_acknowledge(now_ns)
            reasons = self._reasons(now_ns)
            counters, clock = self._gate.counts() | self._counters, self._gate.alignment.estimate()
            newest_good_ns, captures, doubts = self._newest_good_ns, self._captures, self._doubts
        tracks.sort(key=lambda t: t[0])
        people, joints = len(tracks), len(JOINTS)
        history: Floats = np.zeros((people, self._steps, joints, 3))
        observed = np.zeros((people, self._steps, joints), np.bool_)
        last: Floats = np.zeros((people, joints, 3))
        age_s: Floats = np.full((people, joints), np.inf)
        for index, (_, ring, capture_ns, _) in enumerate(tracks):
            window, last[index], stamps = ring.recall(capture_ns, self._steps, self._rate_hz)
            history[index], observed[index] = window.positions, window.observed
            ever = stamps != NEVER
            age_s[index, ever] = (capture_ns - stamps[ever]) * 1e-9
        snapshot = PeopleSnapshot(
            now_ns=now_ns,
            ids=tuple(t[0] for t in tracks),
            history=history,
            observed=observed,
            capture_ns=np.array([t[2] for t in tracks], np.int64),
            last_positions=last,
            joint_age_s=age_s,
            lost=distinct(lost, (t[0] for t in tracks)),
            reasons=reasons,
            newest_capture_ns=newest_good_ns,
            captures=captures,
            counters=counters,
            clock=clock,
            to_acknowledge=to_acknowledge,
            recent=recent_captures([t[1] for t in tracks], joints),
            doubts=doubts,
            errors_m=np.array([t[3] for t in tracks], np.float64),
        )
        return with_inferred(snapshot, self._inference, self._rate_hz)

    def _reasons(self, now_ns: int) -> tuple[Reason, ...]:
        """Return the faults of the input, the most informative first."""
        if self._receipt_ns is None:
            return (Reason.NO_INPUT,)
        silent = now_ns - self._receipt_ns > self.stale_ns
        stale = self._newest_good_ns is None or now_ns - self._newest_good_ns > self.stale_ns
        repeats = [self._gate.repeats, *(track.repeats for track in self._tracks.values())]
        frozen = max(repeats) >= self._settings.frozen_scenes
        unplaced = self._unplaced.reasons
        found = [
            (stale and silent, Reason.INPUT_STALE),
            *((True, doubt.reason) for doubt in self._doubts),
            (self._blind, Reason.SOURCE_BLIND),
            (frozen and not silent, Reason.INPUT_FROZEN),
            (Sign.RELATIVE in self._signs, Reason.INPUT_RELATIVE),
            (bool(self._signs - {Sign.RELATIVE}), Reason.INPUT_REPEATS),
            (self._gate.alignment.jumped, Reason.CLOCK_JUMP),
            (self._impossible or Reason.INPUT_IMPOSSIBLE in unplaced, Reason.INPUT_IMPOSSIBLE),
            (self._misplaced, Reason.BODY_NOT_UPRIGHT),
            (self._coasts or Reason.PERSON_NOT_LOCATED in unplaced, Reason.PERSON_NOT_LOCATED),
            (Reason.TOO_MANY_PEOPLE in unplaced, Reason.TOO_MANY_PEOPLE),
            (stale and not silent and self._gate.alignment.late, Reason.CLOCK_DRIFT),
            (stale and not silent, Reason.INPUT_STALE),
            (self._lost.distrusted, Reason.STATE_UNTRUSTED),
            (self._lost.forgotten and not self._lost.distrusted, Reason.ROOM_NOT_SEEN_EMPTY),
        ]
        return tuple(dict.fromkeys(reason for holds, reason in found if holds))
