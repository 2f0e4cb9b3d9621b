"""Settings of this project's ROS 2 nodes; can be imported without ROS 2."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints

from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.base.settings import Settings

MAX_DOMAIN = 232
"""Largest domain whose ports exist (design.ros2.org, "ROS_DOMAIN_ID")."""
Discovery = Literal["localhost", "subnet"]
NodeName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=64)]
TopicName = Annotated[
    str,
    StringConstraints(pattern=r"^/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*$",
                      max_length=200),
]  # fmt: skip


class Ros2Settings(Settings):
    """Settings of every ROS 2 node here; for the source and the link."""

    domain_id: int | None = Field(
        None, ge=0, le=MAX_DOMAIN, description="ROS domain; default: ROS_DOMAIN_ID, or 0"
    )
    discovery: Discovery = Field(
        "localhost",
        description="localhost: nodes of this machine only; subnet: all machines in the network",
    )
    node_name: NodeName = Field("hri_predict", description="name of the node in the ROS graph")

    safety: ClassVar[Safety] = harmless("domain_id")
