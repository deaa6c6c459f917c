"""The service's replies: dictionaries whose keys are attributes, too; SI units throughout."""

from __future__ import annotations

from servotune.replies.base import Reply
from servotune.replies.cycles import LimitCycle, OperatingPoint, PredictedCycle
from servotune.replies.datasets import ChannelData, Dataset
from servotune.replies.fits import (
    BlackBox,
    DriveParameters,
    Estimate,
    Fit,
    FitReport,
    Identification,
    MeasuredCurves,
    OutputValidation,
    StaticCurve,
    Validation,
)
from servotune.replies.frfs import Frf, FrfOutput
from servotune.replies.influence import (
    Change,
    Coefficient,
    Elasticity,
    Influence,
    PredictedMetric,
    Prediction,
    Strongest,
)
from servotune.replies.jobs import Expected, ExpectedCost, JobState
from servotune.replies.optimizations import (
    Alternative,
    Certificate,
    CertifiedGoal,
    CrossCheck,
    Evaluated,
    FrontPoint,
    GoalResult,
    Map,
    Optimization,
    Share,
)
from servotune.replies.spectra import BandEnergy, Harmonics, Spectrum, SpectrumVariant
from servotune.replies.studies import (
    Crossing,
    FrequencyResponse,
    FrequencyVariant,
    Margins,
    Nyquist,
    Simulation,
    SimulationVariant,
    Unbounded,
)
from servotune.replies.systems import CatalogItem, StateSpace, Stored
from servotune.replies.values import Metric, Root, Warned

__all__ = [
    "Alternative",
    "BandEnergy",
    "BlackBox",
    "CatalogItem",
    "Certificate",
    "CertifiedGoal",
    "Change",
    "ChannelData",
    "Coefficient",
    "CrossCheck",
    "Crossing",
    "Dataset",
    "DriveParameters",
    "Elasticity",
    "Estimate",
    "Evaluated",
    "Expected",
    "ExpectedCost",
    "Fit",
    "FitReport",
    "FrequencyResponse",
    "FrequencyVariant",
    "Frf",
    "FrfOutput",
    "FrontPoint",
    "GoalResult",
    "Harmonics",
    "Identification",
    "Influence",
    "JobState",
    "LimitCycle",
    "Map",
    "Margins",
    "MeasuredCurves",
    "Metric",
    "Nyquist",
    "OperatingPoint",
    "Optimization",
    "OutputValidation",
    "PredictedCycle",
    "PredictedMetric",
    "Prediction",
    "Reply",
    "Root",
    "Share",
    "Simulation",
    "SimulationVariant",
    "Spectrum",
    "SpectrumVariant",
    "StateSpace",
    "StaticCurve",
    "Stored",
    "Strongest",
    "Unbounded",
    "Validation",
    "Warned",
]
