"""Sockets that several processes of the service share."""

from __future__ import annotations

import asyncio
import socket

import pytest

from api.processes.listeners import _bound


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_no_packet_of_an_answer_waits_for_an_acknowledgement(host) -> None:
    async def accepted() -> int:
        found = asyncio.get_running_loop().create_future()

        async def answer(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            found.set_result(
                writer.get_extra_info("socket").getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
            )  # RFC 896 is off
            writer.close()

        async with await asyncio.start_server(answer, sock=_bound(host, 0)) as server:
            _, writer = await asyncio.open_connection(*server.sockets[0].getsockname()[:2])
            writer.close()
            return await found

    assert asyncio.run(accepted()) != 0
