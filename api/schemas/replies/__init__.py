"""The replies, for the API reference and the contract tests; services make them as plain documents."""

from __future__ import annotations

from api.schemas.replies.base import (
    Curve,
    FaultReply,
    Item,
    MetricReply,
    Number,
    Page,
    Pole,
    ProblemReply,
    Reply,
    StudyReply,
    SystemReference,
    VerdictWord,
    WarningReply,
)
from api.schemas.replies.catalog import ElementEntry, MethodEntry, MetricEntry, ParameterEntry, SignalEntry
from api.schemas.replies.cycles import LimitCycleReply, OperatingPointReply, PredictedCycleReply
from api.schemas.replies.datasets import (
    ChannelReply,
    DatasetHead,
    DatasetReply,
    FunctionReply,
    PreviewReply,
    SegmentReply,
)
from api.schemas.replies.health import Health, Readiness
from api.schemas.replies.influence import (
    ChangeReply,
    CoefficientReply,
    ElasticityReply,
    InfluenceReply,
    PredictedMetric,
    PredictionReply,
    Strongest,
)
from api.schemas.replies.jobs import JobReply, KeptResult, ResultHead
from api.schemas.replies.studies import (
    Crossing,
    FrequencyReply,
    FrequencyVariant,
    Margins,
    NyquistReply,
    SimulationReply,
    SimulationVariant,
)
from api.schemas.replies.systems import Matrix, RevisionHead, StateSpaceReply, StoredSystem, SystemHead
from api.schemas.replies.validations import FitReply, ValidatedOutput, ValidationCurves, ValidationReply

__all__ = [
    "ChangeReply",
    "ChannelReply",
    "CoefficientReply",
    "Crossing",
    "Curve",
    "DatasetHead",
    "DatasetReply",
    "ElasticityReply",
    "ElementEntry",
    "FaultReply",
    "FitReply",
    "FrequencyReply",
    "FrequencyVariant",
    "FunctionReply",
    "Health",
    "InfluenceReply",
    "Item",
    "JobReply",
    "KeptResult",
    "LimitCycleReply",
    "Margins",
    "Matrix",
    "MethodEntry",
    "MetricEntry",
    "MetricReply",
    "Number",
    "NyquistReply",
    "OperatingPointReply",
    "Page",
    "ParameterEntry",
    "Pole",
    "PredictedCycleReply",
    "PredictedMetric",
    "PredictionReply",
    "PreviewReply",
    "ProblemReply",
    "Readiness",
    "Reply",
    "ResultHead",
    "RevisionHead",
    "SegmentReply",
    "SignalEntry",
    "SimulationReply",
    "SimulationVariant",
    "StateSpaceReply",
    "StoredSystem",
    "Strongest",
    "StudyReply",
    "SystemHead",
    "SystemReference",
    "ValidatedOutput",
    "ValidationCurves",
    "ValidationReply",
    "VerdictWord",
    "WarningReply",
]
