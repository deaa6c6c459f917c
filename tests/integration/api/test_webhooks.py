"""Webhooks: messages are written with what they tell, signed, tried again, given up; and nobody is called who must not be."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address, ip_network

import pytest
from cryptography.fernet import Fernet
from sqlalchemy import select

import servotune
from api.services.jobs.computing import Computing
from api.services.operation.app_context import Installation
from api.services.operation.housekeeping import tidy
from api.services.webhooks import alerts
from api.services.webhooks.webhook_delivery import MOST_ATTEMPTS, MOST_FAILURES, PAUSES, Courier
from api.settings import Settings
from servotune.webhooks import SignatureError, verify
from storage import open_database
from storage.errors import QuotaExceededError, VaultError
from storage.jobs.queue import JobQueue
from storage.models import DEFAULT_WORKSPACE, Alert, Job, JobStatus, Webhook, WebhookDelivery, Workspace
from storage.models.base import utc_now
from storage.repositories import JobRepository, WebhookRepository, jobs
from storage.repositories.webhooks import new_secret, renew_secrets
from storage.vault import Vault
from tests.integration.api.conftest import Service, serving
from tests.integration.coroutines import run
from tests.support.receiver import Receiver, receiving

HERE = ip_network("127.0.0.0/8")
EVENTS = ["job.succeeded", "job.failed", "job.cancelled"]


class Desk:
    """A service without its loops: what is due is sent when the test says so, at the time that it says."""

    def __init__(self, database, *, networks=(HERE,), lookup=None, keys=()) -> None:
        self.database = database
        self.now = utc_now()
        settings = Settings(webhook_networks=list(networks))
        self.queue = JobQueue(database)
        self.service = Installation(
            settings=settings,
            database=database,
            queue=self.queue,
            computing=Computing(settings),
            vault=Vault(keys, plain=True),
        )
        self.options = {"clock": lambda: self.now} | ({"lookup": lookup} if lookup else {})

    def hook(self, url: str, events=tuple(EVENTS), *, active: bool = True, workspace: str = DEFAULT_WORKSPACE) -> str:
        with self.database.session() as session:
            repository = WebhookRepository(session, workspace)
            secret = self.service.vault.seal(new_secret())
            return repository.create(name="x", url=url, events=list(events), active=active, secret=secret).id

    def end_job(self, status=JobStatus.SUCCEEDED, *, roll_back: bool = False) -> str:
        with self.database.session() as session:
            job = self.queue.enqueue(session, kind="optimization", body={}, workspace_id=DEFAULT_WORKSPACE)
        with self.database.session() as session:
            jobs.begin(session, job.id, worker="w", ticket=job.ticket)
            error = {"type": "t", "title": "T", "detail": "why"} if status == JobStatus.FAILED else None
            jobs.finish(session, job.id, status=status, attempt=1, error=error)
            if roll_back:
                session.rollback()
        self.now = max(self.now, utc_now())
        return job.id

    def send(self) -> int:
        """Send what is due; return how many messages that was."""

        async def once() -> int:
            courier = Courier(self.service, **self.options)
            count = await courier.start_due()
            await courier.settle()
            await courier.close()
            return count

        return run(once())

    def webhook(self, identifier: str) -> Webhook:
        with self.database.session() as session:
            return WebhookRepository(session, DEFAULT_WORKSPACE).get(identifier)

    def deliveries(self, identifier: str) -> list[WebhookDelivery]:
        with self.database.session() as session:
            return list(WebhookRepository(session, DEFAULT_WORKSPACE).deliveries(identifier).items)


@pytest.fixture
def desk(database) -> Iterator[Desk]:
    made = Desk(database)
    yield made
    made.queue.close()


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    with receiving() as running:
        yield running


def test_the_end_of_a_job_is_told_and_signed(desk, receiver) -> None:
    identifier = desk.hook(receiver.url)
    secret = desk.webhook(identifier).secret
    for status in (JobStatus.SUCCEEDED, JobStatus.FAILED, JobStatus.CANCELLED):
        job = desk.end_job(status)
        assert desk.send() == 1
        headers, body = receiver.got[-1]
        message = verify(secret, headers, body, now=desk.now.timestamp())
        assert message["type"] == f"job.{status}"
        assert message["workspace"] == DEFAULT_WORKSPACE
        assert (message["data"]["id"], message["data"]["status"]) == (job, status)
        assert message["data"]["error"] == ({"type": "t", "title": "T", "detail": "why"} if "fail" in status else None)
        assert headers["Host"] == receiver.url.split("/")[2]
        with pytest.raises(SignatureError):
            verify(secret, headers, body + b" ", now=desk.now.timestamp())
    log = desk.deliveries(identifier)
    assert [(row.status, row.attempts, row.response_status) for row in log] == [("delivered", 1, 204)] * 3
    assert {row.id for row in log} == {headers["webhook-id"] for headers, _ in receiver.got}
    assert desk.send() == 0


def test_what_is_rolled_back_is_not_told(desk, receiver) -> None:
    identifier = desk.hook(receiver.url)
    desk.end_job(roll_back=True)
    assert desk.deliveries(identifier) == []


def test_only_what_waits_for_it_is_told(desk, receiver) -> None:
    with desk.database.session() as session:
        session.add(Workspace(id="ws_other", name="other"))
    others = desk.hook(receiver.url, workspace="ws_other")
    failures = desk.hook(receiver.url, ["job.failed"])
    asleep = desk.hook(receiver.url, active=False)
    desk.end_job()
    assert desk.deliveries(failures) == desk.deliveries(asleep) == []
    with desk.database.session() as session:
        assert WebhookRepository(session, "ws_other").deliveries(others).items == []


def test_a_message_is_tried_again_later_and_later_under_the_same_id(desk) -> None:
    with receiving([500, 503, 204]) as receiver:
        identifier = desk.hook(receiver.url)
        desk.end_job()
        for pause in PAUSES[:2]:
            assert desk.send() == 1
            (row,) = desk.deliveries(identifier)
            assert row.status == "pending"
            assert row.next_at == desk.now + pause
            desk.now += pause - timedelta(seconds=1)
            assert desk.send() == 0
            desk.now += timedelta(seconds=1)
        assert desk.webhook(identifier).failures == 2
        assert desk.send() == 1
        (row,) = desk.deliveries(identifier)
        assert (row.status, row.attempts, row.response_status) == ("delivered", 3, 204)
        assert (desk.webhook(identifier).failures, desk.webhook(identifier).retry_at) == (0, None)
        assert len({headers["webhook-id"] for headers, _ in receiver.got}) == 1
        assert len({headers["webhook-timestamp"] for headers, _ in receiver.got}) == 3


def test_a_receiver_that_is_down_for_days_is_given_up(desk) -> None:
    with receiving([500]) as receiver:
        identifier = desk.hook(receiver.url)
        began = desk.now
        desk.end_job()
        desk.end_job()
        for _ in range(MOST_FAILURES):
            assert desk.webhook(identifier).active
            assert desk.send() == 1  # a pause holds for all that is sent to it
            desk.now += max(PAUSES)
        assert len(receiver.got) == MOST_FAILURES
    webhook = desk.webhook(identifier)
    assert (webhook.active, webhook.failures) == (False, MOST_FAILURES)
    assert "12 attempts in a row failed, the last one because the receiver must answer with 2xx" in (
        webhook.disabled_reason or ""
    )
    last, first = desk.deliveries(identifier)
    assert {first.status, last.status} == {"failed"}
    assert [first.attempts, last.attempts] == [MOST_ATTEMPTS, MOST_FAILURES - MOST_ATTEMPTS]
    assert sum(PAUSES[: MOST_ATTEMPTS - 1], timedelta()) > timedelta(days=1)
    assert desk.now - began > timedelta(days=3)
    desk.end_job()
    assert len(desk.deliveries(identifier)) == 2
    with desk.database.session() as session:
        row = WebhookRepository(session, DEFAULT_WORKSPACE).update(identifier, expected_revision=2, active=True)
        assert (row.active, row.failures, row.disabled_reason, row.retry_at) == (True, 0, None, None)


def test_a_receiver_that_is_gone_is_told_nothing_more(desk) -> None:
    with receiving([410]) as receiver:
        identifier = desk.hook(receiver.url)
        desk.end_job()
        desk.send()
    assert desk.webhook(identifier).disabled_reason == "the receiver answered 410 Gone"
    assert [row.status for row in desk.deliveries(identifier)] == ["failed"]


def test_a_redirection_is_not_followed(desk, receiver) -> None:
    with receiving([307]) as redirecting:
        redirecting.headers = {"Location": receiver.url}
        identifier = desk.hook(redirecting.url)
        desk.end_job()
        desk.send()
    (row,) = desk.deliveries(identifier)
    assert (row.status, row.response_status) == ("pending", 307)
    assert "redirection, which is not followed" in (row.error or "")
    assert receiver.got == []


def test_a_name_that_has_become_a_private_address_is_not_called(database, receiver) -> None:
    answers = [[ip_address("127.0.0.1")], [ip_address("10.0.0.1")], [], [ip_address("127.0.0.1")]]
    desk = Desk(database, lookup=lambda _host, _port: answers.pop(0))
    identifier = desk.hook(receiver.url.replace("127.0.0.1", "ci.example.com"))
    desk.end_job()
    desk.send()
    assert len(receiver.got) == 1  # the operator allows this one
    assert receiver.got[0][0]["Host"].startswith("ci.example.com:")
    desk.end_job()
    for says in ("must have a public address, got ci.example.com, which is 10.0.0.1", "whose name means an address"):
        desk.send()
        assert says in (desk.deliveries(identifier)[0].error or "")
        desk.now += max(PAUSES)
    desk.send()
    assert len(receiver.got) == 2
    desk.queue.close()


def test_nobody_there(desk, receiver) -> None:
    identifier = desk.hook("http://127.0.0.1:1/")
    desk.end_job()
    desk.send()
    assert desk.deliveries(identifier)[0].error == "the receiver cannot be reached: ConnectError"


def test_of_two_processes_one_sends(desk, receiver) -> None:
    desk.hook(receiver.url)
    for _ in range(3):
        desk.end_job()

    async def race() -> None:
        couriers = [Courier(desk.service, **desk.options) for _ in range(2)]
        for _ in range(3):
            await asyncio.gather(*(courier.start_due() for courier in couriers))
            for courier in couriers:
                await courier.settle()
        for courier in couriers:
            await courier.close()

    run(race())
    assert len(receiver.got) == 3
    assert len({headers["webhook-id"] for headers, _ in receiver.got}) == 3


def test_a_message_whose_sender_died_is_sent_again(desk, receiver) -> None:
    identifier = desk.hook(receiver.url)
    desk.end_job()

    async def die() -> None:
        courier = Courier(desk.service, **desk.options)
        await courier.start_due()
        await courier.close()

    run(die())
    (row,) = desk.deliveries(identifier)
    if row.status == "pending":
        desk.now += timedelta(minutes=1)
        assert desk.send() == 1
    assert [row.status for row in desk.deliveries(identifier)] == ["delivered"]


def test_a_failed_validation_raises_one_alert_however_often_its_job_is_computed(desk, receiver) -> None:
    identifier = desk.hook(receiver.url, ["alert.validation"])
    result = {
        "verdict": "fail",
        "limit_percent": 10.0,
        "outputs": {"y": {"relative_error_percent": 12.34}, "z": {"relative_error_percent": 3.0}},
        "system": {"id": "sys_1", "revision": 2},
        "dataset": "ds_1",
    }
    for _ in range(2):
        with desk.database.session() as session:
            alerts.on_validation(session, DEFAULT_WORKSPACE, job="job_1", result=result)
    with desk.database.session() as session:
        alerts.on_validation(session, DEFAULT_WORKSPACE, job="job_2", result=result | {"verdict": "pass"})
        (alert,) = session.scalars(select(Alert))
    assert alert.detail == "relative error must be at most 10 %, got y 12.3 %"
    desk.now = utc_now()
    assert desk.send() == 1
    message = verify(desk.webhook(identifier).secret, *receiver.got[0], now=desk.now.timestamp())
    assert message["type"] == "alert.validation"
    assert message["data"]["job"] == "job_1"
    assert message["data"]["relative_error_percent"] == {"y": 12.34, "z": 3.0}


def test_old_deliveries_and_alerts_are_forgotten(desk, receiver) -> None:
    identifier = desk.hook(receiver.url)
    for _ in range(2):
        desk.end_job()
    desk.send()
    with desk.database.session() as session:
        old, pending = datetime(2020, 1, 1, tzinfo=UTC), 0
        for row in session.scalars(select(WebhookDelivery)):
            row.created_at = old
            pending += row.status == "pending"
        session.add(Alert(id="alr_1", workspace_id=DEFAULT_WORKSPACE, kind="validation", source="s", detail="d",
                          data={}, created_at=old))  # fmt: skip
    assert pending == 1
    tidy(desk.service)
    assert [row.status for row in desk.deliveries(identifier)] == ["pending"]
    with desk.database.session() as session:
        assert session.scalars(select(Alert)).all() == []


# Over HTTP


@pytest.fixture(scope="module")
def lively(sqlite_template, tmp_path_factory) -> Iterator[Service]:
    """A service whose operator lets webhooks call this machine."""
    path = tmp_path_factory.mktemp("webhooks") / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}", webhook_networks=[HERE]) as running:
        yield running


def test_a_user_is_told_by_the_running_service(lively, receiver) -> None:
    with servotune.connect(lively.url, key=lively.keys["admin"]) as client:
        made = client.webhooks.create("ci", url=receiver.url, events=["job.cancelled"])
        assert made["secret"] is not None
        assert "secret" not in client.webhooks.get(made["id"])
        client.webhooks.test(made["id"])
        message = verify(made["secret"], *receiver.wait(1)[0])
        assert message["type"] == "webhook.test"
        changed = client.webhooks.update(made["id"], made["document"] | {"name": "ci 2", "active": False})
        assert (changed["name"], changed["active"], changed["revision"]) == ("ci 2", False, 2)
        assert [hook["id"] for hook in client.webhooks.list()] == [made["id"]]
        assert [row["event"] for row in client.webhooks.deliveries(made["id"])] == ["webhook.test"]
        assert list(client.webhooks.deliveries(made["id"], status="failed")) == []
        assert list(client.alerts.list(kind="validation")) == []
        with pytest.raises(servotune.NotFoundError):
            client.alerts.get("alr_none")
        client.webhooks.delete(made["id"])
        with pytest.raises(servotune.NotFoundError):
            client.webhooks.get(made["id"])


def test_the_end_of_a_job_is_told_by_the_running_service(lively, receiver) -> None:
    with lively.client() as client:
        made = client.post("/v1/webhooks", json={"name": "ci", "url": receiver.url, "events": ["job.cancelled"]}).json()
        job = _queued(lively)
        assert client.post(f"/v1/jobs/{job}/cancel").json()["status"] == "cancelled"
        message = verify(made["secret"], *receiver.wait(1)[0])
        assert (message["type"], message["data"]["id"]) == ("job.cancelled", job)
        client.delete(f"/v1/webhooks/{made['id']}", headers={"If-Match": "*"})


def _queued(service: Service) -> str:
    database = open_database(service.database_url)
    with database.session() as session:
        job: Job = JobRepository(session, DEFAULT_WORKSPACE).create(kind="optimization", body={})
    database.dispose()
    return job.id


@pytest.mark.parametrize(
    ("change", "pointer", "says"),
    [
        ({"url": "http://169.254.169.254/latest/meta-data/"}, "/url", "url must have a public address, got 169.254"),
        ({"url": "http://10.0.0.1:8000/"}, "/url", "url must have a public address"),
        ({"url": "file:///etc/passwd"}, "/url", "url must begin with https:// or http://"),
        ({"url": "https://user:secret@example.com/"}, "/url", "url must be without a user and a password"),
        ({"url": "https://example.com/" + "x" * 2000}, "/url", "url must have at most 2000 characters, got 2020"),
        ({"url": ""}, "/url", "url must have at least 1 character, got 0"),
        ({"events": []}, "/events", "events must have at least 1 item, got 0"),
        ({"events": ["job.began"]}, "/events/0", "events/0 must be 'job.succeeded', 'job.failed'"),
        ({"secret": "mine"}, "/secret", "secret must be left out"),
    ],
)
def test_a_webhook_that_cannot_be_is_refused(lively, change, pointer, says) -> None:
    body = {"name": "x", "url": "https://example.com/", "events": ["job.failed"]} | change
    with lively.client() as client:
        reply = client.post("/v1/webhooks", json=body)
    assert reply.status_code == 422
    assert reply.headers["Content-Type"] == "application/problem+json"
    (fault,) = reply.json()["errors"]
    assert fault["pointer"] == pointer
    assert says in fault["detail"]


def test_secrets_are_encrypted_at_rest_and_outlive_a_change_of_the_key(database, receiver) -> None:
    old, new = Fernet.generate_key().decode(), Fernet.generate_key().decode()
    plain = Desk(database)
    identifier = plain.hook(receiver.url)
    secret = plain.webhook(identifier).secret
    plain.queue.close()

    def starting(*keys: str) -> int:
        with database.session() as session:
            return renew_secrets(session, Vault(keys).renewed)

    assert (starting(), starting(old), starting(old)) == (0, 1, 0)
    kept = Vault([old]).seal(secret), plain.webhook(identifier).secret
    assert all(secret.removeprefix("whsec_") not in text for text in kept)
    assert Fernet(old).decrypt(kept[1].removeprefix("fernet:")).decode() == secret
    for keys in ((), (new,)):
        with pytest.raises(VaultError, match="got none" if not keys else "got another"):
            starting(*keys)
    assert (starting(new, old), starting(new)) == (1, 0)
    for keys in ((new,), (old,)):
        desk = Desk(database, keys=keys)
        desk.end_job()
        desk.send()
        desk.queue.close()
    verify(secret, *receiver.got[0], now=desk.now.timestamp())
    failed, arrived = desk.deliveries(identifier)
    assert (arrived.status, failed.status, len(receiver.got)) == ("delivered", "pending", 1)
    assert "the key must be the one" in failed.error


@pytest.mark.parametrize("key", ["short", "A" * 43 + "=,", "!" * 44])
def test_a_key_that_is_none_is_refused_without_being_shown(key) -> None:
    with pytest.raises(ValueError, match="must be 32 bytes in base64") as refused:
        Settings(secret_key=key)
    assert key not in str(refused.value)
    assert Settings(secret_key="").secret_keys == ()
    pair = Settings(secret_key="+/" * 21 + "+=, " + "A" * 43 + "=").secret_keys
    assert pair == ("-_" * 21 + "-=", "A" * 43 + "=")


def test_a_secret_is_kept_as_it_is_only_where_a_setting_allows_it(sqlite_template, tmp_path, receiver) -> None:
    body = {"name": "ci", "url": receiver.url, "events": ["job.failed"]}
    for plain, status in ((False, 409), (True, 201)):
        path = tmp_path / f"{plain}.db"
        path.write_bytes(sqlite_template.read_bytes())
        given = {"secret_key": None, "plain_secrets": plain, "webhook_networks": [HERE]}
        with serving(f"sqlite:///{path}", **given) as service, service.client() as client:
            reply = client.post("/v1/webhooks", json=body)
            assert reply.status_code == status, reply.text
            assert plain or "set SERVOTUNE_SECRET_KEY (openssl rand -base64 32), or" in reply.json()["detail"]
            assert len(client.get("/v1/webhooks").json()["items"]) == plain


def test_a_repeated_creation_shows_no_secret_twice(lively) -> None:
    body = {"name": "x", "url": "http://127.0.0.1:9/", "events": ["job.failed"]}
    with lively.client() as client:
        first, second = (client.post("/v1/webhooks", json=body, headers={"Idempotency-Key": "hook"}) for _ in range(2))
        assert first.json()["secret"].startswith("whsec_")
        assert second.json() == first.json() | {"secret": None}
        stale = client.put(f"/v1/webhooks/{first.json()['id']}", json=body, headers={"If-Match": '"7"'})
        assert stale.status_code == 412
        client.delete(f"/v1/webhooks/{first.json()['id']}", headers={"If-Match": '"1"'})


def test_only_admins_make_webhooks_and_everybody_reads_alerts(lively) -> None:
    for key in ("read", "write", "run"):
        with lively.client(key) as client:
            assert client.get("/v1/webhooks").status_code == 403
            assert client.get("/v1/alerts").status_code == 200


def test_a_workspace_has_at_most_so_many(desk) -> None:
    with desk.database.session() as session:
        session.get_one(Workspace, DEFAULT_WORKSPACE).limits = {"webhooks": 1}
    desk.hook("https://example.com/")
    with pytest.raises(QuotaExceededError, match="at most 1 webhooks"):
        desk.hook("https://example.com/")
