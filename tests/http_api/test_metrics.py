"""`/metrics`, read back by the parser of prometheus_client."""

import httpx
from prometheus_client.parser import text_string_to_metric_families

from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.health import AxisCondition


async def _samples(client: httpx.AsyncClient) -> dict[tuple[str, ...], float]:
    """Samples by name and labels, the labels in the order of their names."""
    answer = await client.get("/metrics")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/plain")
    return {
        (
            sample.name.removeprefix("edge_service_"),
            *(value for _name, value in sorted(sample.labels.items())),
        ): sample.value
        for family in text_string_to_metric_families(answer.text)
        for sample in family.samples
    }


async def test_metrics_say_what_the_board_says(scene, client):
    scene.hear_preload()
    scene.hear_health(condition=AxisCondition.WARNING, data_faults={"gap": 3})
    scene.hear_component("acquire", axis="X", counters={"samples": 7})
    scene.hear_component("http")
    scene.wait(0.5)
    samples = await _samples(client)
    assert samples["preload_percent", "X"] == 6.71
    assert samples["preload_low_percent", "X"] == 6.58
    assert samples["preload_newtons", "X"] == 500.1
    assert samples["drag_torque_high_newton_metres", "X"] == 0.143
    assert samples["stiffness_newtons_per_metre", "X"] == 3.6e7
    assert samples["stiffness_low_newtons_per_metre", "X"] == 3.4e7
    assert samples["estimate_age_seconds", "X"] == 0.5
    assert samples["estimate_status", "X", "estimated"] == 1.0
    assert samples["estimate_status", "X", "invalid"] == 0.0
    assert samples["axis_condition", "X", "WARNING"] == 1.0
    assert samples["axis_condition", "Y", "UNAVAILABLE"] == 1.0
    assert samples["data_faults_total", "X", "gap"] == 3.0
    assert samples["component_status", "X", "acquire", "ok"] == 1.0
    assert samples["component_status", "", "http", "ok"] == 1.0
    assert samples["component_counts_total", "X", "acquire", "samples"] == 7.0
    assert samples["ready",] == 0.0


async def test_number_that_does_not_exist_has_no_sample(scene, client):
    scene.hear_preload()
    scene.wait(10.0)
    samples = await _samples(client)
    assert not [
        key for key in samples if key[0].startswith(("preload", "drag", "stiff", "normalised"))
    ]
    assert samples["estimate_status", "X", "unestimated"] == 1.0
    assert samples["estimate_age_seconds", "X"] == 10.0
    assert ("estimate_age_seconds", "Y") not in samples


async def test_standing_axis_has_no_sample(scene, client):
    scene.hear_preload(status=EstimateStatus.INSUFFICIENT_EXCITATION)
    assert ("preload_percent", "X") not in await _samples(client)


async def test_lost_payloads_are_counted(scene, client):
    scene.hear_preload()
    scene.sequence += 4
    scene.hear_preload()
    assert (await _samples(client))["lost_payloads_total", "X", "preload"] == 4.0
