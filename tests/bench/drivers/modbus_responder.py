"""Many Modbus devices in one process, of structs and nothing else: the other side of a bench.

`python modbus_responder.py COUNT` prints its ports in one line. A line
`hang INDEX` on its input keeps that device from answering, `answer INDEX` lets it; it ends with it.
"""

import asyncio
import struct
import sys

HEADER = struct.Struct(">HHHBBHH")
REPLY = struct.Struct(">HHHBBB")


class Device:
    """Answers every read with a counter in each register, unless it hangs."""

    def __init__(self) -> None:
        self.answering = asyncio.Event()
        self.answering.set()
        self._reads = 0

    async def talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while True:
                packet = await reader.readexactly(HEADER.size)
                await self.answering.wait()
                transaction, _, _, unit, function, _, count = HEADER.unpack(packet)
                self._reads += 1
                words = [self._reads % 30_000] * count
                head = REPLY.pack(transaction, 0, 3 + 2 * count, unit, function, 2 * count)
                writer.write(head + struct.pack(f">{count}H", *words))
        except (asyncio.IncompleteReadError, OSError):
            pass
        finally:
            writer.close()


async def respond(count: int) -> None:
    devices = [Device() for _ in range(count)]
    servers = [await asyncio.start_server(each.talk, "127.0.0.1", 0) for each in devices]
    ports = [server.sockets[0].getsockname()[1] for server in servers]
    sys.stdout.write(" ".join(map(str, ports)) + "\n")
    sys.stdout.flush()
    while line := await asyncio.to_thread(sys.stdin.readline):
        command, index = line.split()
        answering = devices[int(index)].answering
        answering.clear() if command == "hang" else answering.set()
    for server in servers:
        server.close()


if __name__ == "__main__":
    asyncio.run(respond(int(sys.argv[1])))
