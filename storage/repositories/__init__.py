"""One file per aggregate. A repository takes a session, sees one workspace only, and never commits."""

from __future__ import annotations

from storage.repositories.acquisition_templates import AcquisitionTemplateRepository
from storage.repositories.acquisitions import AcquisitionRepository
from storage.repositories.agents import AgentRepository
from storage.repositories.alerts import AlertRepository
from storage.repositories.api_keys import ApiKeyRepository, authenticate, note_uses
from storage.repositories.comments import CommentRepository
from storage.repositories.datasets import DatasetRepository
from storage.repositories.idempotency import Answer, Claim, IdempotencyRepository
from storage.repositories.jobs import JobRepository
from storage.repositories.lineage import LineageRepository
from storage.repositories.processings import ProcessingRepository
from storage.repositories.results import ResultRepository
from storage.repositories.schedules import ScheduleRepository
from storage.repositories.sign_ins import SignInRepository, Visitor, open_principals
from storage.repositories.systems import SystemRepository
from storage.repositories.webhooks import WebhookRepository
from storage.repositories.workers import WorkerRepository
from storage.repositories.workspaces import WorkspaceRepository

__all__ = [
    "AcquisitionRepository",
    "AcquisitionTemplateRepository",
    "AgentRepository",
    "AlertRepository",
    "Answer",
    "ApiKeyRepository",
    "Claim",
    "CommentRepository",
    "DatasetRepository",
    "IdempotencyRepository",
    "JobRepository",
    "LineageRepository",
    "ProcessingRepository",
    "ResultRepository",
    "ScheduleRepository",
    "SignInRepository",
    "SystemRepository",
    "Visitor",
    "WebhookRepository",
    "WorkerRepository",
    "WorkspaceRepository",
    "authenticate",
    "note_uses",
    "open_principals",
]
