"""Publishes JointStates of a robot that swings slowly, until killed."""

import argparse
import math
import time

import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--names", default="grip,c,b,a")
    parser.add_argument("--topic", default="/joint_states")
    parser.add_argument("--shift", type=float, default=0.0, help="seconds to add to the stamps")
    parser.add_argument("--freeze", type=float, default=math.inf, help="then repeat the last one")
    parser.add_argument("--rate", type=float, default=100.0)
    wanted = parser.parse_args()
    rclpy.init()
    node = rclpy.create_node("robot")
    publisher = node.create_publisher(JointState, wanted.topic, qos_profile_sensor_data)
    message = JointState(name=wanted.names.split(","))
    start, sent = time.monotonic(), 0
    while True:
        seconds = time.monotonic() - start
        if seconds < wanted.freeze:
            at_ns = time.time_ns() + round(wanted.shift * 1e9)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(at_ns, 10**9)
            swing = 0.1 * math.sin(seconds), 0.1 * math.cos(seconds)
            places = [10.0 * (ord(name[0]) - 96) for name in message.name]
            message.position = [place + swing[0] for place in places]
            message.velocity = [swing[1]] * len(places)
        publisher.publish(message)
        sent += 1
        time.sleep(max(0.0, start + sent / wanted.rate - time.monotonic()))
