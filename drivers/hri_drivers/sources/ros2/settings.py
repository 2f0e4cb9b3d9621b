"""``source:`` of ``kind: ros2``; can be imported without ROS 2."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from hri_drivers.sources.live import LiveSettings
from hri_drivers.wires.ros2_settings import Ros2Settings, TopicName
from hri_predict.base.quantities.safe_side import Safety
from hri_predict.protocol.ros.bodies import MARKER_ARRAY, POSE_ARRAY
from hri_predict.protocol.ros.tracked import IDS_LIST
from hri_predict.protocol.ros.zed import OBJECTS

KINDS = {
    "pose_array": POSE_ARRAY,
    "marker_array": MARKER_ARRAY,
    "ros4hri": IDS_LIST,
    "zed": OBJECTS,
}


class Ros2SourceSettings(Ros2Settings, LiveSettings):
    """``source:`` of ``kind: ros2``."""

    kind: Literal["ros2"]
    topics: Annotated[list[TopicName], Field(min_length=1, max_length=16)] = Field(
        description="topic of all people, or one topic for each person"
    )
    message: Literal["pose_array", "marker_array", "ros4hri", "zed"] = Field(
        "pose_array",
        description="geometry_msgs/PoseArray; visualization_msgs/MarkerArray as Azure Kinect's "
        "driver publishes it; hri_msgs/IdsList of bodies whose frames are in /tf; or "
        "zed_msgs/ObjectsStamped",
    )
    frame: str = Field(
        min_length=1,
        max_length=200,
        description="frame_id whose pose is room_from_source; other frames are resolved through "
        "/tf",
    )
    units: Literal["m", "cm", "mm"] = Field("m", description="unit of the positions")
    axes: Annotated[list[str], Field(min_length=3, max_length=3)] = Field(
        ["x", "y", "z"],
        description="axes of 'frame' that point forward, left and up; [z, -x, -y] for an optical "
        "frame",
    )
    stamp: Literal["header", "arrival"] = Field(
        "header",
        description="source of the capture time; with arrival, give the delay before arrival as "
        "min_latency_s",
    )
    reliability: Literal["best_effort", "reliable"] = Field(
        "best_effort", description="requested QoS; best_effort receives from every publisher"
    )
    sees_room: bool = Field(
        description="true only if a message without people means that the sensor sees the room; "
        "required"
    )
    allow_unauthenticated: bool = Field(
        False, description="with discovery: subnet, believe any node in the network"
    )

    safety: ClassVar[Safety] = {}

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.discovery != "localhost" and not self.allow_unauthenticated:
            raise ValueError(
                "ROS 2 accepts network input, and any node could claim an empty room: set "
                "'allow_unauthenticated: true' if no strangers can access the network"
            )
        if len({topic.removeprefix("/") for topic in self.topics}) < len(self.topics):
            raise ValueError("topics: a topic is named twice; name each once")
        if len(self.topics) > 1 and self.message != "pose_array":
            raise ValueError("several topics need 'message: pose_array', with one person each")
        if self.message == "ros4hri" and (self.joint_map == "canonical" or self.units != "m"):
            raise ValueError(
                "message: ros4hri needs 'joint_map: ros4hri', or your own map whose joints are "
                "frames of REP-155, and 'units: m'"
            )
        return self

    @property
    def needs_tf(self) -> bool:
        """Whether people are placed by ``/tf`` alone."""
        return self.message == "ros4hri"
