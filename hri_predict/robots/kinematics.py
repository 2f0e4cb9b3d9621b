"""Forward kinematics of a serial chain of joints, vectorised over configurations.

A revolute joint turns its child link about a fixed axis of its parent; a prismatic joint shifts the
link along that axis: ``T_parent_child(q) = pre . Rot(axis, q) . post``, or ``pre . Trans(axis q) .
post``. A URDF joint is ``pre = origin, post = 1``; a row of classic (distal) Denavit-Hartenberg
parameters is ``pre = 1, axis = z, post = Rz(theta) Tz(d) Tx(a) Rx(alpha)`` (J. J. Craig,
"Introduction to Robotics", names the other, modified, convention; Universal Robots publish the
classic one). A configuration is in rad, and in m for prismatic joints.
"""

from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import cross


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """One joint: (4, 4) transforms before and after its motion, and a unit (3,) axis.

    The joint turns about the axis, or slides along it.
    """

    pre: Floats
    axis: Floats
    post: Floats
    slides: bool = False


def dh_joint(a: float, alpha: float, d: float, theta: float, *, slides: bool = False) -> Joint:
    """Return a joint from a classic DH row, metres and radians.

    The joint position is added to ``theta``, or to ``d`` for a prismatic joint.
    """
    z_turn, x_turn = np.eye(4), np.eye(4)
    z_turn[:3, :3] = _turn(np.array([0.0, 0.0, 1.0]), theta)
    z_turn[2, 3] = d
    x_turn[:3, :3] = _turn(np.array([1.0, 0.0, 0.0]), alpha)
    x_turn[0, 3] = a
    return Joint(np.eye(4), np.array([0.0, 0.0, 1.0]), z_turn @ x_turn, slides)


def origin_joint(xyz: Floats, rpy: Floats, axis: Floats, *, slides: bool = False) -> Joint:
    """Return a joint as in URDF: origin in its parent (m; fixed-axis roll, pitch, yaw) and axis."""
    pre = np.eye(4)
    turns = [_turn(np.eye(3)[i], rpy[i]) for i in range(3)]
    pre[:3, :3] = turns[2] @ turns[1] @ turns[0]
    pre[:3, 3] = xyz
    return Joint(pre, np.asarray(axis, float) / np.linalg.norm(axis), np.eye(4), slides)


def _skew(v: Floats) -> Floats:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _blocks(joint: Joint) -> Floats:
    """(3, 4, 4) of ``pre Rot(q) post``, for 1, sin q, cos q; of ``pre Trans(q) post``: 1, q, 0."""
    blocks = np.zeros((3, 4, 4))
    if joint.slides:
        blocks[0] = joint.pre @ joint.post
        blocks[1, :3, 3] = joint.pre[:3, :3] @ joint.axis
        return blocks
    along = np.outer(joint.axis, joint.axis)
    for k, rotation in enumerate((along, _skew(joint.axis), np.eye(3) - along)):
        blocks[k, :3] = joint.pre[:3, :3] @ rotation @ joint.post[:3]
    blocks[0, :3, 3] += joint.pre[:3, 3]
    blocks[0, 3, 3] = 1.0
    return blocks


def _turn(axis: Floats, angle: float) -> Floats:
    k = _skew(axis)
    rotation: Floats = np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k
    return rotation


class Chain:
    """A serial chain of N joints on a fixed base; link 0 is the base, link i moves with joint i.

    Args:
        base: (4, 4) pose of the base in the frame of the results.
        joints: N joints from the base outwards.

    Attributes:
        dof: N.
        geometry: base (3, 4), blocks (N, 3, 16), (N,) which joints are prismatic, and (N, 3, 2)
            each joint's axis and origin in the parent's frame; for ``links_of`` and ``twists_of``.
    """

    def __init__(self, base: Floats, joints: list[Joint]) -> None:
        self.dof = len(joints)
        self._joints = joints
        # pre Rot(q) post is linear in 1, sin q and cos q (Rodrigues). So each joint has three
        # constant 4 x 4 blocks, and one product gives all joints' local transforms: (N, 3, 16).
        # pre Trans(q) post is linear in 1 and q, so q takes the place of sin q.
        blocks = np.array([_blocks(joint) for joint in joints]).reshape(self.dof, 3, 16)
        axis_and_origin = np.array(
            [np.column_stack([j.pre[:3, :3] @ j.axis, j.pre[:3, 3]]) for j in joints]
        )
        slides = np.array([joint.slides for joint in joints], np.bool_)
        self.geometry = np.array(base[:3], np.float64), blocks, slides, axis_and_origin

    def links(self, q: Floats) -> Floats:
        """(N+1, ..., 3, 4) rotation and position of every link at configurations q (..., N)."""
        return links_of(*self.geometry[:3], np.asarray(q, np.float64))

    def arms(self, link: int, point: Floats) -> Floats:
        """Return lengths (N,) of the rigid pieces between the joint axes, from joint 1 to a point.

        Piece i is fixed to link i + 1. It runs from a point on that link's own axis to a point on
        the next axis, or to ``point`` (3,) of ``link``. Pieces beyond that link are 0. In every
        configuration, the distance of a point of the link from axis j is at most the sum of the
        pieces from j on plus the absolute prismatic positions after j, because a prismatic joint
        adds its position, as a vector along its axis, between two pieces.
        """
        lengths = np.zeros(self.dof)
        for i in range(link):
            post = self._joints[i].post
            start = -post[:3, :3].T @ post[:3, 3]  # the axis' point in the child's frame
            end = point if i == link - 1 else self._joints[i + 1].pre[:3, 3]
            lengths[i] = np.linalg.norm(end - start)
        return lengths


def links_of(base: Floats, blocks: Floats, slides: Bools, q: Floats) -> Floats:
    """(N+1, ..., 3, 4) rotation and position of every link of a ``Chain`` at ``q`` (..., N).

    Args:
        base: (3, 4) pose of link 0.
        blocks: (N, 3, 16) blocks of the joints.
        slides: (N,) which joints are prismatic.
        q: rad, m.
    """
    dof = len(blocks)
    flat = q.reshape(-1, dof).T
    terms = np.ones((*flat.shape, 3))
    np.sin(flat, out=terms[..., 1])
    np.cos(flat, out=terms[..., 2])
    if slides.any():
        terms[slides, :, 1] = flat[slides]
    local = np.matmul(terms, blocks).reshape(*flat.shape, 4, 4)  # (N, R, 4, 4)
    links = np.empty((dof + 1, flat.shape[1], 3, 4))
    links[0] = base
    for i in range(dof):
        np.matmul(links[i], local[i], out=links[i + 1])
    result: Floats = links.reshape(dof + 1, *q.shape[:-1], 3, 4)
    return result


def twists_of(
    axis_and_origin: Floats, slides: Bools, links: Floats, qd: Floats
) -> tuple[Floats, Floats]:
    """Return the angular and linear velocity of every link, as a moving frame at the origin.

    Args:
        axis_and_origin: (N, 3, 2) axis and origin of each joint in its parent's frame.
        slides: (N,) which joints are prismatic.
        links: the result of ``links_of``.
        qd: (..., N) rad/s, m/s.

    Returns:
        ``omega, v0``, each (N+1, ..., 3); a point x of link i moves at ``v0 + omega x x``.
    """
    parent = links[:-1]
    local = axis_and_origin.reshape(len(slides), *(1,) * (qd.ndim - 1), 3, 2)
    turned = np.matmul(parent[..., :3], local)  # (N, ..., 3, 2)
    axis, on_axis = turned[..., 0], turned[..., 1] + parent[..., 3]
    turn = axis * np.moveaxis(qd, -1, 0)[..., None]
    shift = cross(on_axis, turn)
    if slides.any():
        shift[slides], turn[slides] = turn[slides], 0.0
    omega, v0 = np.zeros((2, *links.shape[:-2], 3))
    np.cumsum(turn, axis=0, out=omega[1:])
    np.cumsum(shift, axis=0, out=v0[1:])
    return omega, v0
