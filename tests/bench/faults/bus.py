"""A hostile client on the open bus of a running service: does it live, and is Y disturbed?

python -m tests.bench.faults.bus --messages 100000

The bus is opened for the client: under the default nobody but the service may put anything.
"""

import json
import random
import struct
import tempfile
import time
from pathlib import Path
from typing import Any

import click
import zenoh

from edge_service.messages.codec.edge_block import BLOCK_ENCODING, MAGIC
from edge_service.messages.topics import TOPICS, Topic

from ...drivers.bench import free_port
from ...messages.hostile import NASTY, example
from ..table import Figure, PipelineBench
from .scene import RunningService, configuration, running_service

_ROOT = "feeddrive/v1/bench/lfd"
_FOREIGN = 0.1
_LOOK_EVERY = 250
_BYTES_PER_MB = 1e6
_SETTLE_S, _RECOVERY_S = 10.0, 5.0


def hostile(topic: Topic[Any], rng: random.Random) -> bytes:
    """Bytes made of a good payload of axis X: cut, flipped, or with other members."""
    good = bytearray(example(topic))
    kind = rng.random()
    if kind < 0.2:
        return bytes(good[: rng.randrange(len(good))])
    if kind < 0.4:
        good[rng.randrange(len(good))] ^= 1 << rng.randrange(8)
        return bytes(good)
    start = 8 + struct.unpack_from("<I", good, 4)[0] if topic.encoding == BLOCK_ENCODING else None
    members = json.loads(good if start is None else good[8:start])
    if kind < 0.9:
        members[rng.choice(list(members))] = rng.choice(NASTY)
    else:  # a forgery in good form
        members |= {"sequence": rng.randrange(2**60), "boot_epoch": rng.randrange(2**62)}
    text = json.dumps(members).encode()
    return text if start is None else MAGIC + struct.pack("<I", len(text)) + text + good[start:]


def key_of(topic: Topic[Any], rng: random.Random) -> str:
    """Key of axis X; now and then one of an axis or component that nobody knows."""
    name = "X" if rng.random() >= _FOREIGN else f"Q{rng.randrange(10**6)}"
    axis = f"@component/http/{name}" if topic.name == "status" else name
    return f"{_ROOT}/{axis}/{topic.name}"


def client(port: int) -> zenoh.Session:
    """A client of the bus that knows nothing of the service's own."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def refused(service: RunningService) -> float:
    """Payloads that were refused so far."""
    lines = service.ask("/metrics").body.decode().splitlines()
    counted = [line for line in lines if line.startswith("edge_service_payloads_dropped_total{")]
    return sum(float(line.rpartition(" ")[2]) for line in counted)


def attack(folder: Path, messages: int, seed: int = 1) -> PipelineBench:
    """Put hostile messages on the keys of X, and look at Y meanwhile."""
    rng, port = random.Random(seed), free_port()
    config = configuration(("X", "Y"), folder=folder / "history").replace(
        'endpoint = "tcp/127.0.0.1:0"', f'endpoint = "tcp/127.0.0.1:{port}"\nsecurity = "open"'
    )
    topics, looks, disturbed = list(TOPICS.values()), 0, 0
    with running_service(config, folder) as service:
        service.wait_ready()
        time.sleep(_SETTLE_S)
        before = service.usage().rss_bytes
        with client(port) as session:
            for number in range(messages):
                topic = rng.choice(topics)
                session.put(key_of(topic, rng), hostile(topic, rng))
                if number % _LOOK_EVERY == 0:
                    answer = service.ask("/api/v1/axes/Y/preload").json
                    looks, disturbed = looks + 1, disturbed + (answer["status"] != "estimated")
        recovered_s = service.wait_ready(60.0)
        time.sleep(_RECOVERY_S)
        found = service.ask("/api/v1/axes/X/preload").json["status"] == "estimated"
        grown_mb = (service.usage().rss_bytes - before) / _BYTES_PER_MB
        counted = refused(service)
    figures = (
        Figure("messages", "hostile messages", float(messages), ""),
        Figure("refused", "of them refused and counted by key", counted, "", at_least=1.0),
        Figure("disturbed", f"{looks} looks at Y: without a number", disturbed, "", at_most=0.0),
        Figure("recovered_s", "ready again", recovered_s, "s", at_most=5.0),
        Figure("estimated", "X has a number again", float(found), "", at_least=1.0),
        Figure("grown_mb", "memory grown", grown_mb, "MB", at_most=64.0),
    )
    return PipelineBench(figures, ("a client of the open bus, on the keys of X and invented ones",))


@click.command()
@click.option("--messages", type=click.IntRange(1), default=100_000, show_default=True)
@click.option("--seed", type=int, default=1, show_default=True)
def main(messages: int, seed: int) -> None:
    """Print what comes of hostile messages on the bus."""
    with tempfile.TemporaryDirectory() as folder:
        click.echo(attack(Path(folder), messages, seed).as_text())


if __name__ == "__main__":
    main()
