"""The machine file's content."""

from edge_service.models.machine import ColumnConfig


def test_a_column_as_earlier_versions_knew_it_keeps_the_machine_what_it_was() -> None:
    """Kept states belong to a machine by its content: keys that are not used must not show."""
    kept = {"column": "u_V", "scale": 1.0, "offset": 0.0}
    assert ColumnConfig(column="u_V").model_dump(mode="json") == kept
    assert ColumnConfig(column="a", minus="b").model_dump()["minus"] == "b"
