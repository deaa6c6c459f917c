"""The variables of the object `Acquisition`, and requests that the controller answers by their number."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from typing import Any

from asyncua import ua
from asyncua.client import Client
from asyncua.ua.uaerrors import UaStringParsingError

from agent.drivers.opcua.connection import Connection
from agent.drivers.opcua.settings import OpcuaSettings
from agent.errors import AttemptError

PREPARE, ARM, START, STOP, REST = range(1, 6)
IDLE, READY, RUNNING, FAILED = range(4)
_LOOK = 0.005
_KINDS = {
    "Request": ua.VariantType.UInt32,
    "Command": ua.VariantType.Int32,
    "Rate": ua.VariantType.Double,
    "BlockSamples": ua.VariantType.UInt32,
    "Samples": ua.VariantType.UInt64,
    "Output": ua.VariantType.Int32,
    "Heartbeat": ua.VariantType.UInt32,
    "Taken": ua.VariantType.UInt64,
}
_NEEDED = (
    *_KINDS, "Name", "Model", "Serial", "Inputs", "InputRanges", "Outputs", "OutputRanges", "BlockSize", "State", "Answer",
    "ErrorCode", "Error", "ActualRate", "Written", "Played", "Newest", "Block0",
)  # fmt: skip


class Controller:
    """The program in the controller.

    Parameters
    ----------
    settings : OpcuaSettings
    """

    def __init__(self, settings: OpcuaSettings) -> None:
        self._settings = settings
        self.connection = Connection(settings)
        self._nodes: dict[str, ua.NodeId] = {}

    def nodes(self) -> Mapping[str, ua.NodeId]:
        """Return the variables by their names, found by browsing once."""
        if not self._nodes:
            self._nodes = self.connection.call(self._browse)
            missing = [name for name in _NEEDED if name not in self._nodes]
            if missing:
                self._nodes, named = {}, ", ".join(missing)
                raise AttemptError(
                    "controller_differs",
                    f"{self._settings.object} must have the variables of docs/agent.md, it lacks {named}",
                )
        return self._nodes

    async def _browse(self, client: Client) -> dict[str, ua.NodeId]:
        try:
            parent = client.get_node(self._settings.object)
        except UaStringParsingError as error:
            raise AttemptError(
                "unknown_channel",
                f"daq.object must be a node such as ns=2;s=Acquisition, got {self._settings.object!r}",
            ) from error
        found = await parent.get_children_descriptions()
        return {str(entry.BrowseName.Name): entry.NodeId for entry in found}

    def count(self, stem: str) -> int:
        """Return how many variables there are of a numbered name: Block0, Block1 ..."""
        number = 0
        while f"{stem}{number}" in self.nodes():
            number += 1
        return number

    def read(self, *names: str) -> list[Any]:
        """Return values, in one request."""
        nodes = self.nodes()

        async def work(client: Client) -> list[Any]:
            found = await client.read_attributes([client.get_node(nodes[name]) for name in names])
            for entry in found:
                entry.StatusCode.check()
            return [entry.Value.Value for entry in found]

        return self.connection.call(work)

    def write(self, values: Mapping[str, Any]) -> None:
        """Set variables, in one request."""
        nodes = self.nodes()

        async def work(client: Client) -> None:
            await client.write_values(
                [client.get_node(nodes[name]) for name in values],
                [ua.Variant(value, _KINDS.get(name, ua.VariantType.Double)) for name, value in values.items()],
            )

        self.connection.call(work)

    def obey(self, command: int, values: Mapping[str, Any] = {}, *, within: float) -> int:
        """Make the controller do something, and return the number of the request when it has.

        Parameters
        ----------
        within : float
            s that the controller may take.

        Raises
        ------
        AttemptError
            With the controller's own word and sentence where it has failed; `timeout` when it does not answer the request.
        """
        number = (int(self.read("Answer")[0]) + 1) % 2**32
        self.write({**values, "Command": command})
        self.write({"Request": number})  # afterwards: the controller looks at everything else when this one changes
        give_up_at = time.monotonic() + within
        while True:
            answer, state = self.read("Answer", "State")
            if answer == number:
                break
            if time.monotonic() > give_up_at:
                raise AttemptError(
                    "timeout",
                    f"the controller must answer request {number} within {within:g} s, its Answer is {answer}: see whether "
                    "its program runs",
                )
            time.sleep(_LOOK)
        if state == FAILED:
            raise self.failure()
        return number

    def failure(self) -> AttemptError:
        """Return what the controller complains about."""
        code, text = self.read("ErrorCode", "Error")
        return AttemptError(str(code) or "controller_error", f"the controller: {text or 'it gave no reason'}")

    def blocks(self, numbers: Iterable[int]) -> list[list[float]]:
        """Return blocks of the ring, in one request."""
        return self.read(*(f"Block{number}" for number in numbers))
