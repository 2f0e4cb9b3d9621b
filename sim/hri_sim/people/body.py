"""A human body of constant bone lengths: converts a stance into 21 canonical joints.

Proportions are fractions of stature from Drillis & Contini (1966) as reprinted in Winter,
*Biomechanics and Motor Control of Human Movement* (4th ed., 2009), figure 4.1; the lumbar/thoracic
junction (tenth rib) and the height of the ears from the means of ANSUR II (2012). Arms and legs are
chains of two bones, solved in closed form.
"""

import math
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import JOINTS

_HIP, _KNEE, _ANKLE = 0.530, 0.285, 0.039  # heights
_TORSO, _SHOULDER, _EAR = 0.641, 0.818, 0.924
# Hip joints, not hip breadth: 0.18 m apart at 1.75 m, as in the CMU motion-capture skeleton.
_HALF_HIPS, _HALF_SHOULDERS = 0.103 / 2, 0.259 / 2
_UPPER_ARM, _FOREARM, _HAND, _FOOT = 0.186, 0.146, 0.108, 0.152
_TOE_AHEAD = 0.75 * _FOOT  # the heel is a quarter of the foot behind the ankle (own estimate)
_TOE_HEIGHT = 0.012

_STRAIGHT = 0.985  # of a limb's length: knees and elbows never lock
_SOFT_M = 0.03  # width of the pelvis's smooth change from one leg's limit to the other's
_REACH, _LONGEST = 0.96, 0.995  # shares of an arm's length: at a target, and on the way
_ABDUCTION, _ELBOW_FLEXION = math.radians(8), math.radians(25)  # of an arm at rest
_SWING = 0.7  # radians of arm swing per leg length that the opposite foot is ahead
_BULGE_M = 0.08  # a reaching hand keeps in front of its own shoulder
MAX_LEAN = math.radians(35)

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class Foot:
    """A foot: ankle above ``xy`` (2,) metres, pointing along ``heading``, ``lift`` metres up."""

    xy: Floats
    heading: float
    lift: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Stance:
    """The place and posture of a body.

    Attributes:
        xy: (2,) position of the pelvis over the floor, metres; ``heading`` radians from +x.
        left, right: the feet.
        crouch: metres by which the pelvis stays below standing height.
        lean: pitch of the trunk, radians forward.
        hand: "left" or "right", the reaching one.
        reach: 0 (arm at rest) to 1 (finger tip on ``target``).
        target: (3,) metres.
    """

    xy: Floats
    heading: float
    left: Foot
    right: Foot
    crouch: float = 0.0
    lean: float = 0.0
    hand: str = "right"
    reach: float = 0.0
    target: Floats | None = None


class Body:
    """A body of one stature."""

    def __init__(self, height_m: float) -> None:
        self.height_m = height_m
        self.leg = (_HIP - _ANKLE) * height_m
        self.arm = (_UPPER_ARM + _FOREARM) * height_m
        self.half_hips = _HALF_HIPS * height_m

    def standing(self, xy: Floats, heading: float) -> Stance:
        """Return a stance with both feet under the hips."""
        left = _across(heading) * self.half_hips
        return Stance(
            xy=xy, heading=heading, left=Foot(xy + left, heading), right=Foot(xy - left, heading)
        )

    def joints(self, stance: Stance) -> Floats:
        """(21, 3) canonical joints, metres, z up."""
        h, at = self.height_m, dict[str, Floats]()
        ahead, left = _ahead3(stance.heading), _across3(stance.heading)
        feet = {"l": stance.left, "r": stance.right}
        ankles = {s: np.array([*f.xy, _ANKLE * h + f.lift]) for s, f in feet.items()}
        waist = np.array([*stance.xy, 0.0])
        hips = {s: waist + sign * self.half_hips * left for s, sign in (("l", 1), ("r", -1))}
        rise = np.array([0.0, 0.0, self._pelvis_height(hips, ankles, stance.crouch)])
        at["waist"] = waist + rise
        for side, foot in feet.items():
            hip, ankle = hips[side] + rise, ankles[side]
            at[f"{side}_hip"], at[f"{side}_ankle"] = hip, ankle
            thigh, shank = (_HIP - _KNEE) * h, (_KNEE - _ANKLE) * h
            at[f"{side}_knee"] = two_bones(
                start=hip, end=ankle, first=thigh, second=shank, side=ahead
            )
            toe = _TOE_AHEAD * h * _ahead3(foot.heading)
            at[f"{side}_foot"] = ankle + toe - (_ANKLE - _TOE_HEIGHT) * h * UP
        spine = math.sin(stance.lean) * ahead + math.cos(stance.lean) * UP
        for joint, height in (
            ("torso", _TORSO), ("neck", _SHOULDER), ("head", _EAR), ("head_top", 1.0)
        ):  # fmt: skip
            at[joint] = at["waist"] + (height - _HIP) * h * spine
        for side, sign, other in (("l", 1.0, stance.right), ("r", -1.0, stance.left)):
            shoulder = at["neck"] + sign * _HALF_SHOULDERS * h * left
            swing = _SWING * float((other.xy - stance.xy) @ ahead[:2]) / self.leg
            at[f"{side}_shoulder"] = shoulder
            reaching = stance.hand[0] == side and stance.target is not None
            reach, target = (stance.reach, stance.target) if reaching else (0.0, None)
            arm = self._arm(
                shoulder=shoulder,
                ahead=ahead,
                outward=sign * left,
                swing=swing,
                reach=reach,
                target=target,
            )
            at[f"{side}_elbow"], at[f"{side}_wrist"], at[f"{side}_hand"] = arm
        return np.array([at[joint] for joint in JOINTS])

    def reach_limits(self) -> tuple[float, float]:
        """Return the minimum and maximum distance (m) of a fingertip from its shoulder."""
        hand = _HAND * self.height_m
        return hand + 0.35 * self.arm, hand + _REACH * self.arm

    def _pelvis_height(
        self, hips: dict[str, Floats], ankles: dict[str, Floats], crouch: float
    ) -> float:
        """Return the maximum height that legs and crouch allow; a soft minimum avoids a kink."""
        limits = [_ANKLE * self.height_m + _STRAIGHT * self.leg - crouch]
        for side, hip in hips.items():
            across = ankles[side][:2] - hip[:2]
            room = max((_STRAIGHT * self.leg) ** 2 - float(across @ across), 0.0)
            limits.append(float(ankles[side][2]) + math.sqrt(room))
        low = min(limits)
        return low - _SOFT_M * math.log(sum(math.exp((low - v) / _SOFT_M) for v in limits))

    def _arm(
        self,
        *,
        shoulder: Floats,
        ahead: Floats,
        outward: Floats,
        swing: float,
        reach: float,
        target: Floats | None,
    ) -> tuple[Floats, Floats, Floats]:
        """Return elbow, wrist and fingertip of one arm."""
        h = self.height_m
        upper, fore, hand = _UPPER_ARM * h, _FOREARM * h, _HAND * h
        hang = math.sin(_ABDUCTION) * outward - math.cos(_ABDUCTION) * UP
        wrist = upper * (math.sin(swing) * ahead + math.cos(swing) * hang)
        bent = swing + _ELBOW_FLEXION
        wrist = wrist + fore * (math.sin(bent) * ahead + math.cos(bent) * hang)
        pointing = None
        if target is not None and reach > 0.0:
            pointing = (target - shoulder) / np.linalg.norm(target - shoulder)
            goal = target - shoulder - hand * pointing
            wrist = (1 - reach) * wrist + reach * goal
            wrist = wrist + 4 * reach * (1 - reach) * _BULGE_M * ahead
        wrist = shoulder + self._within_reach(wrist)
        elbow = two_bones(
            start=shoulder,
            end=wrist,
            first=upper,
            second=fore,
            side=_elbow_side(wrist - shoulder, ahead, outward),
        )
        along = (wrist - elbow) / fore
        if pointing is not None:
            along = (1 - reach) * along + reach * pointing
            along = along / np.linalg.norm(along)
        return elbow, wrist, wrist + hand * along

    def _within_reach(self, wrist: Floats) -> Floats:
        """Limit a wrist (3,), relative to its shoulder, smoothly to the arm's length."""
        distance = float(np.linalg.norm(wrist)) / self.arm
        if distance <= _REACH:
            return wrist
        room = _LONGEST - _REACH
        return wrist * ((_REACH + room * math.tanh((distance - _REACH) / room)) / distance)


def two_bones(*, start: Floats, end: Floats, first: float, second: float, side: Floats) -> Floats:
    """Return the joint between two bones from ``start`` to ``end``, bent towards ``side``.

    All (3,) metres; ``end`` must be within reach and ``side`` not along the line.
    """
    line = end - start
    distance = float(np.linalg.norm(line))
    along = line / distance
    across = side - (side @ along) * along
    across = across / np.linalg.norm(across)
    d = (first**2 - second**2 + distance**2) / (2 * distance)
    return start + d * along + math.sqrt(max(first**2 - d**2, 0.0)) * across


def _elbow_side(arm: Floats, ahead: Floats, outward: Floats) -> Floats:
    """Return the elbow's direction: back and out for a hanging arm, turned by the minimal rotation.

    The direction is smooth everywhere except straight overhead.
    """
    along, down = arm / np.linalg.norm(arm), -UP
    rest = -0.9 * ahead + 0.3 * outward
    axis = _cross(down, along)
    once = _cross(axis, rest)
    return np.asarray(rest + once + _cross(axis, once) / (1.0 + float(down @ along)))


def _cross(a: Floats, b: Floats) -> Floats:
    """Return a x b of two vectors (3,), ten times faster than ``np.cross`` for one pair."""
    ax, ay, az = a
    bx, by, bz = b
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _ahead3(heading: float) -> Floats:
    return np.array([math.cos(heading), math.sin(heading), 0.0])


def _across3(heading: float) -> Floats:
    return np.array([-math.sin(heading), math.cos(heading), 0.0])


def _across(heading: float) -> Floats:
    return _across3(heading)[:2]
