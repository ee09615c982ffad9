"""The loop closed: an axis changes in mid-run; the service sees it, keeps it, and says why."""

from pathlib import Path

import pytest

from edge_service.config_tables import StoreConfig

from .conftest import config_of, once, served

CHANGES_S = 250.0
PATIENCE_S = 300.0


@pytest.mark.slow
async def test_what_begins_in_mid_run_is_seen_kept_and_named(tmp_path: Path) -> None:
    settings = {
        "scenario": "healthy",
        "speed": 20.0,
        "effects": [f"position_friction:excess_nm=0.15,from_s={CHANGES_S}"],
    }
    config = config_of("simulated", settings, store=StoreConfig(folder=tmp_path / "history"))
    async with served(config) as (_, client):
        name = await once(
            client, "axes/X/health", lambda h: (h["consistency"] or {}).get("recording"), PATIENCE_S
        )
        health = (await client.get("api/v1/axes/X/health")).json()
        assert health["consistency"]["state"] == "disagrees"
        raised = lambda h: "model" in [each["alarm"] for each in h["alarms"]]  # noqa: E731
        await once(client, "axes/X/health", raised, PATIENCE_S)
        log = (await client.get("api/v1/log?axis=X")).json()["items"]
        ours = [each for each in log if each.get("data", {}).get("recording") == name]
        told = {each["kind"]: each for each in ours}
        assert told["model_disagrees"]["data"]["since_s"] == pytest.approx(CHANGES_S, abs=15.0)
        assert "recording_kept" in told
        kept = (await client.get("api/v1/recordings")).json()["items"]
        assert name in [each["name"] for each in kept]
        asked = await client.post(
            "api/v1/jobs", json={"command": "diagnose", "axis": "X", "recordings": [name]}
        )
        assert asked.status_code == 202
        path = asked.headers["location"].removeprefix("/api/v1/")
        job = await once(client, path, lambda j: j["state"] != "running" and j, PATIENCE_S)
        assert job["state"] == "done", job["lines"]
        document = (await client.get(f"api/v1/{path}/files/diagnosis.json")).json()
        named = {each["name"]: each["probability"] for each in document["effects"]}
        assert named["position_friction"] > 0.9
        report = await client.get(f"api/v1/{path}/files/report.html")
        assert "Position friction" in report.text
