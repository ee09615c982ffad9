"""Preload and stiffness along the stroke over HTTP, of a profile that can be reckoned by hand."""

from dataclasses import replace

import httpx
import numpy as np
import pytest

from edge_service.health.service_state import ServiceState
from edge_service.http_api.app import create_app
from edge_service.messages.keys import MachineKeys
from edge_service.models.screw.stroke_profile import StrokeProfile

from .conftest import client_of

PATH = "/api/v1/axes/X/wear"
RAMP = StrokeProfile(
    position_m=np.array([0.0, 1.0, 2.0]),
    fresh_percent=10.0,
    preload_share=np.array([0.5, 1.0, 1.5]),
    compliance_m_per_n=np.full(3, 1e-8),
    compliance_tolerance=0.1,
    nut_m_per_n=0.0,
    nut_sigma_m_per_n=0.0,
)
"""Preload rises along two metres; the nut takes no part in the stiffness."""
ONE_ENCODER = replace(RAMP, compliance_m_per_n=np.full(3, np.nan))


def telling(scene, profile: StrokeProfile | None) -> httpx.AsyncClient:
    scene.state = ServiceState({"X": None}, scene.now_ns, place=MachineKeys("hall", "m1"))
    app = create_app(
        scene.state,
        lambda: scene.now_ns,
        read_stroke=lambda _axis, preload: profile and profile.told(preload),
    )
    return client_of(app)


async def test_the_estimate_is_spread_along_the_stroke(scene):
    async with telling(scene, RAMP) as client:
        scene.hear_preload(preload_percent=4.0, low=3.0, high=5.0)
        answer = (await client.get(PATH)).json()["stroke"]
    assert answer["position_m"] == [0.0, 1.0, 2.0]
    assert answer["preload_percent"] == {
        "commissioned": [5.0, 10.0, 15.0],
        "value": [2.0, 4.0, 6.0],
        "low": [1.5, 3.0, 4.5],
        "high": [2.5, 5.0, 7.5],
    }
    stiffness = answer["stiffness_n_per_m"]
    assert stiffness["value"] == stiffness["commissioned"] == [1e8, 1e8, 1e8]
    assert stiffness["low"] == [pytest.approx(1e8 / 1.196, rel=1e-4)] * 3


async def test_one_encoder_knows_no_stiffness_and_no_commissioning_nothing(scene):
    async with telling(scene, ONE_ENCODER) as client:
        scene.hear_preload()
        answer = (await client.get(PATH)).json()["stroke"]
        assert answer["preload_percent"]["value"] is not None
        assert answer["stiffness_n_per_m"] is None
    async with telling(scene, None) as client:
        answer = await client.get(PATH)
        assert (answer.status_code, answer.json()["stroke"]) == (200, None)


async def test_the_axes_say_which_machine_they_belong_to(scene):
    async with telling(scene, None) as client:
        answer = (await client.get("/api/v1/axes")).json()
    assert (answer["site"], answer["machine"]) == ("hall", "m1")
