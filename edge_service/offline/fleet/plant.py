"""Table of a whole plant, asked from its fleet nodes."""

from ...bus.plant.fleet import ask_rows, present_nodes
from ...bus.plant.session import PlantAwayError, PlantSession, PlantSettings
from ...health.fleet.plant_rows import PlantTable, plant_table


async def ask_plant(settings: PlantSettings, timeout_s: float) -> PlantTable:
    """All axes of a plant, the worst first; what is not shown is named.

    Raises PlantAwayError: no router answers, or no fleet node is there.
    """
    session = await PlantSession.open(settings)
    try:
        names = await present_nodes(session.zenoh, timeout_s)
        answers = await ask_rows(session.zenoh, timeout_s)
    finally:
        await session.close()
    if not names and not answers:
        raise PlantAwayError(f"no fleet node is there at {settings.endpoint}")
    return plant_table(answers, names)
