"""Receivers believe what is signed, fresh and whole, and nothing else."""

from __future__ import annotations

import pytest

from api.services.webhooks.webhook_delivery import signature
from servotune.webhooks import SignatureError, verify

# The example of the reference implementations (github.com/standard-webhooks/standard-webhooks).
SECRET = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"
BODY = b'{"test": 2432232314}'
HEADERS = {
    "Webhook-Id": "msg_p5jXN8AQM9LWM0D4loKWxJek",
    "webhook-timestamp": "1614265330",
    "WEBHOOK-SIGNATURE": "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=",
}
NOW = 1614265330.0


def test_the_published_example_is_signed_as_it_is() -> None:
    signed = signature(SECRET, message_id="msg_p5jXN8AQM9LWM0D4loKWxJek", timestamp=1614265330, body=BODY)
    assert signed == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="


def test_the_published_example_is_believed() -> None:
    assert verify(SECRET, HEADERS, BODY, now=NOW) == {"test": 2432232314}
    several = HEADERS | {"WEBHOOK-SIGNATURE": f"v1,AAAA {HEADERS['WEBHOOK-SIGNATURE']}"}
    assert verify(SECRET, several, BODY, now=NOW + 299) == {"test": 2432232314}


@pytest.mark.parametrize(
    ("secret", "headers", "body", "now", "says"),
    [
        (SECRET, {}, BODY + b" ", NOW, "signature must be that of the secret"),
        ("whsec_" + "A" * 32, {}, BODY, NOW, "signature must be that of the secret"),
        (SECRET, {"Webhook-Id": "msg_other"}, BODY, NOW, "signature must be that of the secret"),
        (SECRET, {"webhook-timestamp": "1614265331"}, BODY, NOW, "signature must be that of the secret"),
        (SECRET, {}, BODY, NOW + 301, "must be at most 300 s, got 301 s"),
        (SECRET, {}, BODY, NOW - 301, "must be at most 300 s, got -301 s"),
        (SECRET, {"webhook-timestamp": "yesterday"}, BODY, NOW, "must have an id, a timestamp and a signature"),
        ("whsec_no base64!", {}, BODY, NOW, "the secret must be whole"),
    ],
)
def test_nothing_else_is(secret, headers, body, now, says) -> None:
    with pytest.raises(SignatureError, match=says):
        verify(secret, HEADERS | headers, body, now=now)


def test_a_message_without_its_headers_is_refused() -> None:
    with pytest.raises(SignatureError, match="webhook-id"):
        verify(SECRET, {}, BODY, now=NOW)
