"""The tables. Importing this package makes ``Base.metadata`` complete."""

from __future__ import annotations

from storage.models.access import AuditEntry, SignIn, Ticket
from storage.models.acquisition import (
    Acquisition,
    AcquisitionAttempt,
    AcquisitionStatus,
    AcquisitionTemplate,
    Agent,
    FollowUp,
    Rig,
)
from storage.models.base import Base
from storage.models.blob import Blob, BlobChunk, UnnamedObject
from storage.models.comment import Comment
from storage.models.dataset import ChannelBlock, Dataset, DatasetSegment, DatasetStatus
from storage.models.idempotency import Idempotency
from storage.models.job import Elected, Job, JobEvent, JobState, JobStatus, JobTally, Priority, Worker
from storage.models.lineage import LineageEdge
from storage.models.processing import Processing, ProcessingSource
from storage.models.result import Result, ResultArray
from storage.models.schedule import RunOutcome, Schedule, ScheduleRun
from storage.models.system import System, SystemRevision
from storage.models.webhook import Alert, DeliveryStatus, Webhook, WebhookDelivery
from storage.models.workspace import DEFAULT_WORKSPACE, ApiKey, Workspace

__all__ = [
    "DEFAULT_WORKSPACE",
    "Acquisition",
    "AcquisitionAttempt",
    "AcquisitionStatus",
    "AcquisitionTemplate",
    "Agent",
    "Alert",
    "ApiKey",
    "AuditEntry",
    "Base",
    "Blob",
    "BlobChunk",
    "ChannelBlock",
    "Comment",
    "Dataset",
    "DatasetSegment",
    "DatasetStatus",
    "DeliveryStatus",
    "Elected",
    "FollowUp",
    "Idempotency",
    "Job",
    "JobEvent",
    "JobState",
    "JobStatus",
    "JobTally",
    "LineageEdge",
    "Priority",
    "Processing",
    "ProcessingSource",
    "Result",
    "ResultArray",
    "Rig",
    "RunOutcome",
    "Schedule",
    "ScheduleRun",
    "SignIn",
    "System",
    "SystemRevision",
    "Ticket",
    "UnnamedObject",
    "Webhook",
    "WebhookDelivery",
    "Worker",
    "Workspace",
]
