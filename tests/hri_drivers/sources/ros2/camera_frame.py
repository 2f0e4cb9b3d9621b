"""Publishes on ``/tf_static`` that the frame ``camera`` is 2.5 m above ``map``; until killed."""

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

if __name__ == "__main__":
    rclpy.init()
    node = rclpy.create_node("camera_frame")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    edge = TransformStamped(child_frame_id="camera")
    edge.header.frame_id = "map"
    edge.transform.translation.z = 2.5
    node.create_publisher(TFMessage, "/tf_static", latched).publish(TFMessage(transforms=[edge]))
    rclpy.spin(node)
