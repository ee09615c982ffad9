"""Keys of the configuration that are gone, and what to do instead."""

from typing import Any

GONE: dict[str, str] = {
    "history.folder": "now store.folder",
    "history.budget_mb": "now store.budget_mb",
    "downsample": "gone; edge-service commission --interval states it in the machine file",
    "estimator.activation_exponent": "gone; it is 1.33; edge-service reproduce --exponent",
    "estimator.window_s": "gone; it is 1 s; edge-service reproduce --window",
    "health.warning_percent_of_fresh": "now alarms.warning_percent",
    "health.fault_percent_of_fresh": "now alarms.fault_percent",
    "bus.certificates": "gone; state them in [bus] zenoh_file (deploy/zenoh.json5)",
    "bus.security": "gone; in run others may read; state more in [bus] zenoh_file",
    "bus.tls_endpoint": "gone; state it in [bus] zenoh_file (deploy/zenoh.json5)",
    "webhook": 'gone; put "jsons://HOST/PATH" into the urls_file of [outputs.notify]',
    "email": 'gone; put "mailtos://USER:PASSWORD@HOST" into the urls_file of [outputs.notify]',
    "mqtt": "now [outputs.mqtt], with url for host, port and user",
    "opcua": "now [outputs.opcua], with endpoint for host and port",
    "mtconnect": "now [outputs.mtconnect], with endpoint for host and port",
    "plant": "gone; state the router in [bus] zenoh_file (deploy/zenoh.json5)",
    "http.allowed_hosts": "gone; http.url is the address of a proxy, own names are let in",
    "http.connections": "gone; the limits of a proxy are in its own file (deploy/nginx.conf)",
    "http.tokens_file": "gone; edge-service token CONFIG keeps tokens in the state folder",
    "jobs": "gone; a job ends after an hour, recordings take half of store.budget_mb at most",
}
"""Key with the names of its tables (`bus.security`, `axes.settings.ledger`) -> what to do."""


def gone_keys(content: object) -> list[str]:
    """Gone keys in a parsed configuration, as `key: what to do`."""
    return [f"{key}: {advice}" for key, advice in GONE.items() if _holds(content, key.split("."))]


def _holds(content: object, names: list[str]) -> bool:
    """Presence of a key; in an array of tables that of any of them."""
    if isinstance(content, list):
        return any(_holds(each, names) for each in content)
    table: dict[str, Any] = content if isinstance(content, dict) else {}
    if names[0] not in table:
        return False
    return len(names) == 1 or _holds(table[names[0]], names[1:])
