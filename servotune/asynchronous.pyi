# What type checkers are told of `AsyncClient`. Written by `make stub`: change the client instead.

from collections.abc import AsyncIterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, Literal, Self, type_check_only

from servotune.access import Key, Workspace
from servotune.acquisitions import Acquisition, Unset
from servotune.comments import Comment
from servotune.documents import Document, SystemLike
from servotune.events import Event
from servotune.jobs import ResultT
from servotune.lineage import Direction, LineageGraph
from servotune.progress import Observer
from servotune.repeating import Repeated, Told
from servotune.replies import (
    BlackBox,
    CatalogItem,
    ChannelData,
    Dataset,
    DriveParameters,
    Expected,
    FrequencyResponse,
    Frf,
    Identification,
    Influence,
    Optimization,
    Simulation,
    Spectrum,
    StateSpace,
    StaticCurve,
    Stored,
    Validation,
)
from servotune.results import Form, KeptResult, Language
from servotune.schedules import Schedule, ScheduleRun
from servotune.webhooks import Alert, Delivery, MadeWebhook, Webhook

@type_check_only
class AsyncJob(Generic[ResultT]):
    @property
    def id(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def status(self) -> str: ...
    @property
    def progress(self) -> float: ...
    @property
    def done(self) -> bool: ...
    async def refresh(self) -> AsyncJob[ResultT]: ...
    async def pause(self) -> AsyncJob[ResultT]: ...
    async def resume(self) -> AsyncJob[ResultT]: ...
    async def cancel(self) -> AsyncJob[ResultT]: ...
    def events(self, *, deadline: float | None = ...) -> AsyncIterator[Event]: ...
    async def wait(self, *, progress: bool | Observer = ..., timeout: float | None = ...) -> ResultT: ...
    async def result(self) -> ResultT: ...
    async def request(self) -> dict[str, Any]: ...
    async def script(self) -> str: ...
    async def report(
        self, form: Literal["html", "pdf"] = ..., path: Path | str | None = ..., *, language: Literal["en", "ro"] = ...
    ) -> bytes: ...

@type_check_only
class AsyncAcquisitions:
    async def start(
        self,
        name: str | None = ...,
        *,
        template: str | None = ...,
        rig: str | None = ...,
        channels: Sequence[str] | None = ...,
        sample_rate: float | None = ...,
        duration: float | Mapping[str, Any] | None = ...,
        drive: Mapping[str, Any] | Unset | None = ...,
        pre_trigger: float | Mapping[str, Any] | None = ...,
        trigger: Mapping[str, Any] | Unset | None = ...,
        averages: int | None = ...,
        confirm: bool | None = ...,
        record: bool | None = ...,
        then: Sequence[Mapping[str, Any]] | None = ...,
    ) -> Acquisition: ...
    async def get(self, acquisition: str) -> Acquisition: ...
    def list(self, *, rig: str | None = ..., status: str | None = ...) -> AsyncIterator[Acquisition]: ...
    async def cancel(self, acquisition: str) -> Acquisition: ...
    async def retry(self, acquisition: str) -> Acquisition: ...
    async def job(self, acquisition: str) -> AsyncJob[dict[str, Any]]: ...
    async def wait(self, acquisition: str, *, steps: bool = ..., timeout: float | None = ...) -> Acquisition: ...
    def templates(self) -> AsyncIterator[dict[str, Any]]: ...
    async def keep_template(self, document: Mapping[str, Any]) -> dict[str, Any]: ...
    def rigs(self) -> AsyncIterator[dict[str, Any]]: ...
    def agents(self) -> AsyncIterator[dict[str, Any]]: ...

@type_check_only
class AsyncAlerts:
    async def get(self, alert: str) -> Alert: ...
    def list(self, *, kind: str | None = ..., source: str | None = ...) -> AsyncIterator[Alert]: ...

@type_check_only
class AsyncCatalog:
    async def elements(self) -> list[CatalogItem]: ...
    async def metrics(self) -> list[CatalogItem]: ...
    async def methods(self) -> list[CatalogItem]: ...
    async def signals(self) -> list[CatalogItem]: ...

@type_check_only
class AsyncComments:
    async def create(self, about: str, text: str) -> Comment: ...
    async def get(self, comment: str) -> Comment: ...
    def list(self, *, about: str | None = ...) -> AsyncIterator[Comment]: ...
    async def delete(self, comment: str) -> None: ...

@type_check_only
class AsyncDatasets:
    async def create(self, document: Mapping[str, Any]) -> Dataset: ...
    async def send(
        self,
        dataset: str,
        content: Path | bytes,
        *,
        document: Mapping[str, Any] | None = ...,
        progress: Observer | None = ...,
    ) -> Dataset: ...
    async def upload(
        self, document: Mapping[str, Any], content: Path | bytes, *, progress: Observer | None = ...
    ) -> Dataset: ...
    async def get(self, dataset: str) -> Dataset: ...
    def list(
        self,
        *,
        name: str | None = ...,
        format: str | None = ...,
        status: str | None = ...,
        after: datetime | None = ...,
        before: datetime | None = ...,
    ) -> AsyncIterator[Dataset]: ...
    async def delete(self, dataset: str, *, force: bool = ...) -> None: ...
    async def channel(
        self, dataset: str, name: str, *, start: float | None = ..., end: float | None = ..., points: int | None = ...
    ) -> ChannelData: ...
    async def preview(
        self, dataset: str, content: Path | bytes, *, document: Mapping[str, Any] | None = ...
    ) -> dict[str, Any]: ...
    async def export(
        self,
        dataset: str,
        target: Path,
        *,
        format: str | None = ...,
        channels: Sequence[str] = ...,
        start: float | None = ...,
        end: float | None = ...,
    ) -> Path: ...
    async def original(self, dataset: str) -> bytes: ...

@type_check_only
class AsyncJobs:
    async def get(self, job: str) -> AsyncJob[Any]: ...
    async def start(
        self, kind: Literal["optimization", "identification"], request: Mapping[str, Any]
    ) -> AsyncJob[Any]: ...
    def list(
        self,
        *,
        kind: str | None = ...,
        status: str | None = ...,
        schedule: str | None = ...,
        since: datetime | None = ...,
    ) -> AsyncIterator[AsyncJob[Any]]: ...

@type_check_only
class AsyncKeys:
    async def create(
        self, name: str, *, scopes: Sequence[str], expires_at: str | None = ..., workspace: str | None = ...
    ) -> Key: ...
    def list(self) -> AsyncIterator[Key]: ...
    async def rotate(self, key: str, *, overlap: float = ...) -> Key: ...
    async def revoke(self, key: str) -> None: ...

@type_check_only
class AsyncLineage:
    async def get(self, identifier: str, *, direction: Direction = ...) -> LineageGraph: ...
    async def export(self, identifier: str, output: Path, *, direction: Direction = ...) -> Path: ...
    async def repeat(self, path: Path, *, told: Told = ...) -> list[Repeated]: ...

@type_check_only
class AsyncResults:
    async def get(self, result: str) -> KeptResult: ...
    def list(
        self, *, kind: str | None = ..., after: datetime | None = ..., before: datetime | None = ...
    ) -> AsyncIterator[KeptResult]: ...
    async def report(
        self, result: str, form: Form = ..., path: Path | str | None = ..., *, language: Language = ...
    ) -> bytes: ...

@type_check_only
class AsyncSchedules:
    async def create(
        self,
        name: str,
        *,
        cron: str,
        kind: str,
        body: Mapping[str, Any],
        time_zone: str = ...,
        overlap: str = ...,
        missed: str = ...,
        paused: bool = ...,
        newest: str | None = ...,
    ) -> Schedule: ...
    async def get(self, schedule: str) -> Schedule: ...
    def list(self) -> AsyncIterator[Schedule]: ...
    async def update(self, schedule: str, document: Mapping[str, Any], *, etag: str | None = ...) -> Schedule: ...
    async def delete(self, schedule: str) -> None: ...
    async def pause(self, schedule: str) -> Schedule: ...
    async def resume(self, schedule: str) -> Schedule: ...
    async def trigger(self, schedule: str) -> ScheduleRun: ...
    def runs(self, schedule: str) -> AsyncIterator[ScheduleRun]: ...

@type_check_only
class AsyncSystems:
    async def create(self, document: Document, *, derived_from: str | None = ...) -> Stored: ...
    async def get(self, system: str) -> Stored: ...
    def list(
        self, *, name: str | None = ..., after: datetime | None = ..., before: datetime | None = ...
    ) -> AsyncIterator[Stored]: ...
    async def find(self, name: str) -> Stored: ...
    async def revision(self, system: str, number: int) -> Stored: ...
    def revisions(self, system: str) -> AsyncIterator[Stored]: ...
    async def update(
        self, system: str, document: Document, *, etag: str | None = ..., derived_from: str | None = ...
    ) -> Stored: ...
    async def delete(self, system: str, *, etag: str | None = ..., force: bool = ...) -> None: ...
    async def state_space(
        self, system: SystemLike, *, open_at: str | Sequence[str] | None = ..., parameters: Document | None = ...
    ) -> StateSpace: ...
    async def matlab(self, system: str, *, open_at: str | Sequence[str] | None = ...) -> bytes: ...
    async def etag(self, system: str) -> str: ...

@type_check_only
class AsyncWebhooks:
    async def create(self, name: str, *, url: str, events: Sequence[str], active: bool = ...) -> MadeWebhook: ...
    async def get(self, webhook: str) -> Webhook: ...
    def list(self) -> AsyncIterator[Webhook]: ...
    async def update(self, webhook: str, document: Mapping[str, Any], *, etag: str | None = ...) -> Webhook: ...
    async def delete(self, webhook: str) -> None: ...
    async def test(self, webhook: str) -> Delivery: ...
    def deliveries(self, webhook: str, *, status: str | None = ...) -> AsyncIterator[Delivery]: ...

@type_check_only
class AsyncWorkspaces:
    async def create(self, name: str, *, limits: Mapping[str, int] | None = ...) -> Workspace: ...
    async def get(self, workspace: str) -> Workspace: ...
    def list(self) -> AsyncIterator[Workspace]: ...

class AsyncClient:
    systems: AsyncSystems
    datasets: AsyncDatasets
    jobs: AsyncJobs
    results: AsyncResults
    comments: AsyncComments
    lineage: AsyncLineage
    schedules: AsyncSchedules
    acquisitions: AsyncAcquisitions
    webhooks: AsyncWebhooks
    alerts: AsyncAlerts
    catalog: AsyncCatalog
    keys: AsyncKeys
    workspaces: AsyncWorkspaces
    def __init__(
        self,
        url: str | None = ...,
        *,
        key: str | None = ...,
        profile: str | None = ...,
        wait: float = ...,
        timeout: float = ...,
        attempts: int = ...,
    ) -> None: ...
    async def __aenter__(self) -> Self: ...
    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...
    async def close(self) -> None: ...
    async def simulate(
        self,
        system: SystemLike,
        *,
        input: Document | Sequence[Document],
        outputs: Sequence[str] | None = ...,
        duration: float | None = ...,
        samples: int | None = ...,
        metrics: Sequence[str] | None = ...,
        band: Sequence[float] | None = ...,
        settling_band: Any = ...,
        recovery_band: Any = ...,
        derivative: int | None = ...,
        variants: Sequence[Document] | None = ...,
        keep: bool | None = ...,
    ) -> Simulation: ...
    async def frequency_response(
        self,
        system: SystemLike,
        *,
        from_: str | None = ...,
        to: str | None = ...,
        open_at: str | Sequence[str] | None = ...,
        frequencies: Sequence[float] | None = ...,
        metrics: Sequence[str] | None = ...,
        operating_point: Document | None = ...,
        noise_density: Any = ...,
        paths: Sequence[Document] | None = ...,
        variants: Sequence[Document] | None = ...,
        keep: bool | None = ...,
    ) -> FrequencyResponse: ...
    async def influence(
        self,
        system: SystemLike,
        *,
        input: str,
        output: str,
        parameters: Sequence[str],
        metrics: Sequence[str],
        change: float | None = ...,
        open_at: str | Sequence[str] | None = ...,
        from_: str | None = ...,
        to: str | None = ...,
        signal: Document | None = ...,
        duration: float | None = ...,
        settling_band: Any = ...,
        recovery_band: Any = ...,
        derivative: int | None = ...,
        noise_density: Any = ...,
        predict: Sequence[Document] | None = ...,
        keep: bool | None = ...,
    ) -> Influence: ...
    async def spectrum(
        self,
        system: SystemLike | None = ...,
        *,
        input: Document | Sequence[Document] | None = ...,
        output: str | None = ...,
        dataset: str | None = ...,
        channel: str | None = ...,
        quantity: str | None = ...,
        frequencies: Sequence[float] | None = ...,
        window: str | None = ...,
        segment: float | None = ...,
        overlap: float | None = ...,
        removal: str | None = ...,
        part: Sequence[float] | None = ...,
        duration: float | None = ...,
        samples: int | None = ...,
        fundamental: float | None = ...,
        orders: int | None = ...,
        band: Sequence[float] | None = ...,
        variants: Sequence[Document] | None = ...,
        keep: bool | None = ...,
    ) -> Spectrum: ...
    async def validate(
        self,
        system: SystemLike,
        *,
        dataset: str,
        inputs: Mapping[str, str | Document],
        outputs: Mapping[str, str],
        parameters: Mapping[str, Any] | None = ...,
        offsets: Mapping[str, float] | str | None = ...,
        window: Sequence[float] | None = ...,
        limit_percent: float | None = ...,
        identification: str | None = ...,
        diagnose: str | None = ...,
        movable: Sequence[str] | None = ...,
        points: int | None = ...,
    ) -> Validation: ...
    async def process(
        self,
        sources: str | Sequence[str],
        steps: Sequence[Document] = ...,
        *,
        name: str = ...,
        combine: str | None = ...,
    ) -> Dataset: ...
    async def frf(
        self,
        dataset: str,
        *,
        input: str,
        output: str | Sequence[str],
        estimator: str | None = ...,
        window: str | None = ...,
        segment: float | None = ...,
        overlap: float | None = ...,
        removal: str | None = ...,
        period: float | None = ...,
        settle: float | None = ...,
        steps: Sequence[Document] | None = ...,
        part: Sequence[float] | None = ...,
        band: Sequence[Any] | None = ...,
        form: str | None = ...,
        corrections: Mapping[str, Document] | None = ...,
        confidence: float | None = ...,
        system: SystemLike | None = ...,
        from_: str | None = ...,
        to: str | None = ...,
        parameters: Document | None = ...,
        between_samples: str | None = ...,
        modes: Document | None = ...,
        keep: bool | None = ...,
    ) -> Frf: ...
    async def universal_file(self, result: str) -> bytes: ...
    async def identify(
        self,
        system: SystemLike,
        *,
        parameters: Sequence[str | Document],
        dataset: str | None = ...,
        inputs: Mapping[str, str | Document] | None = ...,
        outputs: Mapping[str, str] | None = ...,
        experiments: Sequence[Document] | None = ...,
        frequency_responses: Sequence[Document] | None = ...,
        offsets: str | None = ...,
        initial_states: str | None = ...,
        estimation: Sequence[float] | None = ...,
        validation: Sequence[float] | None = ...,
        split: float | None = ...,
        starts: int | None = ...,
        max_evaluations: int | None = ...,
        queue: Document | None = ...,
    ) -> AsyncJob[Identification]: ...
    async def expected_cost(
        self, system: SystemLike, *, parameters: Sequence[str | Document], **settings: Any
    ) -> Expected: ...
    async def black_box(
        self,
        dataset: str,
        *,
        inputs: Mapping[str, str],
        outputs: Mapping[str, str],
        method: Literal["subspace", "transfer_function"] = ...,
        orders: Sequence[int] | None = ...,
        largest_delay: float | None = ...,
        offsets: str | None = ...,
        between_samples: Literal["hold", "linear"] | None = ...,
        split: float | None = ...,
        queue: Document | None = ...,
    ) -> AsyncJob[BlackBox]: ...
    async def drive_parameters(self, dataset: str, *, force: str, **settings: Any) -> AsyncJob[DriveParameters]: ...
    async def static_curve(
        self, dataset: str, *, of: str, over: str, degree: int | None = ...
    ) -> AsyncJob[StaticCurve]: ...
    async def optimize(
        self,
        system: SystemLike,
        *,
        variables: Sequence[Document],
        goals: Sequence[Document],
        method: Document | None = ...,
        experiments: Sequence[Document] | None = ...,
        scenarios: Sequence[Document] | None = ...,
        across_scenarios: str | None = ...,
        uncertain: Sequence[Document] | None = ...,
        yield_samples: int | None = ...,
        cross_check: Sequence[str] | None = ...,
        alternatives: Sequence[Document] | None = ...,
        queue: Document | None = ...,
    ) -> AsyncJob[Optimization]: ...
    async def validate_later(self, system: SystemLike, **fields: Any) -> AsyncJob[Validation]: ...
    @property
    def url(self) -> str: ...
    @property
    def key(self) -> str | None: ...
    async def ready(self) -> dict[str, Any]: ...
