"""Applies the node's speed fraction to a robot, and stops it whenever the node is silent.

Needs only ROS 2 (Jazzy or later). Put the robot's own call into ``apply``. An advice is used only
if it is new, complete and fresh. It is valid for SILENCE_S, and until it is OLDEST_S old. A process
that hangs or is killed cannot stop a robot: the robot must stop by itself when these calls cease.
"""

import json
import sys
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import String

SILENCE_S = 0.2  # silence_timeout_s of the link
OLDEST_S = 0.5  # of `hri-predict check`: reject advice older than


class SpeedFollower(Node):
    """Receives the advice for one robot."""

    def __init__(self, topic: str = "/hri/robot_0/advice") -> None:
        super().__init__("speed_follower")
        self.until_s, self.counter, self.fraction, self.applied = 0.0, -1, 0.0, -1.0
        self.create_subscription(String, topic, self.hear, QoSProfile(depth=1))
        self.create_timer(0.01, self.apply)

    def hear(self, message: String) -> None:
        """Process an advice; anything else is treated as not received."""
        try:
            advice = json.loads(message.data)
            counter, fraction = int(advice["counter"]), float(advice["speed_fraction"])
            age_s = OLDEST_S if advice["age_s"] is None else float(advice["age_s"])
            age_s += max(0.0, time.time() - float(advice["stamp"]))  # on the way
        except Exception:
            return
        if counter != self.counter and 0.0 <= fraction <= 1.0 and age_s >= 0.0:
            self.counter, self.fraction = counter, fraction
            self.until_s = time.monotonic() + min(SILENCE_S, OLDEST_S - age_s)
            self.apply()

    def apply(self, stop: bool = False) -> None:
        """Set the robot's speed."""
        fraction = 0.0 if stop or time.monotonic() >= self.until_s else self.fraction
        if fraction != self.applied:
            self.applied = fraction
            print(f"speed {fraction:.3f}", flush=True)  # here: the robot's own call


rclpy.init()
follower = SpeedFollower(*sys.argv[1:2])
try:
    rclpy.spin(follower)
except (KeyboardInterrupt, ExternalShutdownException):
    pass
finally:
    follower.apply(stop=True)
