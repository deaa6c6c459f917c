"""What a Python program does with the client that openapi-python-client makes of the contract. Run by test_generated_clients.py."""

import json
import sys

from contract_client import AuthenticatedClient
from contract_client.api.studies import simulate_v1_simulations_post as simulations
from contract_client.api.systems import create_v1_systems_post as creation
from contract_client.api.systems import delete_v1_systems_identifier_delete as deletion
from contract_client.api.systems import get_v1_systems_identifier_get as reading
from contract_client.api.systems import page_v1_systems_get as listing
from contract_client.models import ProblemReply, SimulationReply, SimulationRequest, StoredSystem, SystemDocument

url, key = sys.argv[1:]
DOCUMENT = {
    "name": "lag",
    "parameters": {"tau": {"value": 0.2, "unit": "s"}},
    "blocks": {
        "u": {"kind": "input"},
        "plant": {"kind": "transfer_function", "numerator": [2], "denominator": ["=tau", 1]},
    },
    "connections": [{"from": "u", "to": "plant"}],
    "outputs": {"y": "plant"},
}

with AuthenticatedClient(base_url=url, token=key, httpx_args={"trust_env": False}) as client:
    made = creation.sync(client=client, body=SystemDocument.from_dict(DOCUMENT), idempotency_key="generated")
    assert isinstance(made, StoredSystem)
    wanted = {
        "system": made.id,
        "input": {"port": "u", "signal": {"kind": "step"}},
        "metrics": ["rise_time"],
        "samples": 11,
    }
    answered = simulations.sync(client=client, body=SimulationRequest.from_dict(wanted))
    assert isinstance(answered, SimulationReply)
    (variant,) = answered.variants
    read = reading.sync_detailed(made.id, client=client)
    listed = listing.sync(client=client, limit=1)
    refused = creation.sync(client=client, body=SystemDocument.from_dict(DOCUMENT | {"outputs": {"y": "nobody"}}))
    assert isinstance(refused, ProblemReply)
    gone = deletion.sync_detailed(made.id, client=client, if_match=read.headers["ETag"])
    found = {
        "rise": variant.metrics["y"]["rise_time"].value,
        "curve": len(variant.outputs["y"]),
        "verdict": variant.verdict.value,
        "listed": [item.id for item in listed.items],
        "identifier": made.id,
        "refused": refused.status,
        "pointer": refused.errors[0].pointer,
        "gone": gone.status_code.value,
    }
    sys.stdout.write(json.dumps(found))
