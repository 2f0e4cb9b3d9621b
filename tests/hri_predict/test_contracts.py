"""Every part that is shipped has the type that its contract says, and the registry says so.

What is asserted here is checked by mypy: an assignment holds a class against its contract, and
``assert_type`` shows what whoever loads it by name gets.
"""

from typing import assert_type

import pytest

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.links.rtde.link import RtdeLink, RtdeLinkSettings
from hri_drivers.links.rtde.packets import Packet
from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_drivers.sources.mvn.source import MvnSettings, MvnSource
from hri_drivers.sources.scene_json.json_source import JsonSettings, JsonSource
from hri_drivers.sources.scene_stream.serial_source import (
    SerialSkeletonSettings,
    SerialSkeletonSource,
)
from hri_drivers.sources.scene_stream.udp_source import UdpSettings, UdpSource
from hri_predict.contracts import cell, registry
from hri_predict.contracts.link import (
    AnyLinkClass,
    ChecksTogether,
    LinkClass,
    ObservesFleet,
    Simulatable,
)
from hri_predict.contracts.link_abilities import OfRobots, Unprotected
from hri_predict.contracts.predictor import AnyPredictorClass, PredictorClass
from hri_predict.contracts.source import AnySourceClass, SourceClass
from hri_predict.predictors.baselines import (
    ConstantVelocity,
    ConstantVelocitySettings,
    ZeroVelocity,
    ZeroVelocitySettings,
)
from hri_predict.predictors.kalman import ConstantAccelerationKalman, KalmanSettings
from hri_predict.predictors.kdformer.model import KDFormerPredictor
from hri_predict.predictors.neural.network import Trained, network_class_of
from hri_predict.predictors.neural.settings import NeuralSettings
from hri_predict.predictors.temporal_aggregation import AggregatedPredictor
from hri_predict.protocol.can import CanFrame
from hri_sim.controllers.cell import MockCell
from hri_sim.faults.injector import FaultySource, FaultyTransport, parse_fault
from hri_sim.people.procedural import ProceduralSettings, ProceduralSource
from hri_sim.replay import RecordingSettings, RecordingSource
from hri_sim.simulation.approach import ApproachSettings, ApproachSource

SERIAL: LinkClass[SerialLinkSettings, bytes] = SerialLink
RTDE: LinkClass[RtdeLinkSettings, Packet] = RtdeLink
CAN: LinkClass[CanLinkSettings, CanFrame] = CanLink

PROCEDURAL: SourceClass[ProceduralSettings] = ProceduralSource
RECORDING: SourceClass[RecordingSettings] = RecordingSource
APPROACH: SourceClass[ApproachSettings] = ApproachSource
UDP: SourceClass[UdpSettings] = UdpSource
MVN: SourceClass[MvnSettings] = MvnSource
JSON: SourceClass[JsonSettings] = JsonSource
SERIAL_SKELETON: SourceClass[SerialSkeletonSettings] = SerialSkeletonSource

ZERO: PredictorClass[ZeroVelocitySettings] = ZeroVelocity
CONSTANT: PredictorClass[ConstantVelocitySettings] = ConstantVelocity
KALMAN: PredictorClass[KalmanSettings] = ConstantAccelerationKalman
KDFORMER: PredictorClass[NeuralSettings] = KDFormerPredictor
AGGREGATED: PredictorClass[NeuralSettings] = AggregatedPredictor
TRAINED: type[Trained] = KDFormerPredictor

CELL: cell.CellClass = MockCell
SOURCE_FAULTS: cell.SourceFaults = FaultySource
LINK_FAULTS: cell.LinkFaults = FaultyTransport
FAULT_PARSER: cell.FaultParser = parse_fault


def test_the_registry_gives_what_the_contracts_say():
    assert assert_type(registry.load("sources", "udp"), AnySourceClass) is UDP
    assert assert_type(registry.load("predictors", "kalman"), AnyPredictorClass) is KALMAN
    assert assert_type(registry.load("links", "can"), AnyLinkClass) is CAN
    assert assert_type(registry.load("cells", "mock"), cell.CellClass) is CELL
    assert assert_type(registry.load("faults", "source"), cell.SourceFaults) is SOURCE_FAULTS
    assert assert_type(registry.load("faults", "link"), cell.LinkFaults) is LINK_FAULTS
    assert assert_type(registry.load("faults", "parse"), cell.FaultParser) is FAULT_PARSER


@pytest.mark.parametrize(
    ("ability", "has", "lacks"),
    [
        (Simulatable, SerialLink, ZeroVelocity),
        (ChecksTogether, CanLink, ZeroVelocity),
        (OfRobots, RtdeLink, SerialLink),
        (Unprotected, RtdeLink, SerialLink),
        (Trained, KDFormerPredictor, ZeroVelocity),
        (ObservesFleet, None, SerialLink),
    ],
)
def test_an_ability_is_had_or_lacked(ability, has, lacks):
    assert has is None or isinstance(has, ability)
    assert not isinstance(lacks, ability)


def test_zenoh_links_observe_a_fleet_and_have_no_simulated_end():
    pytest.importorskip("zenoh")
    cls = registry.load("links", "zenoh")
    assert isinstance(cls, ObservesFleet)
    assert not isinstance(cls, Simulatable)


def test_only_trained_predictors_have_a_network():
    assert network_class_of("kdformer") is KDFormerPredictor.network_class
    assert network_class_of("kalman") is None
