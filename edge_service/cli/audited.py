"""Changes from the command line in the audit log of a service: intent before, outcome after."""

import secrets
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import click

from .options import PATH, InputError

HISTORY = click.option(
    "--history", type=PATH, help="History folder of the service: note the change in its audit log."
)


@contextmanager
def noted(folder: Path | None, action: str, target: str) -> Iterator[None]:
    """Note what is done inside; without a folder say that nobody will know.

    Raises InputError: there is no audit log that can be written; then nothing was done.
    """
    from ..clock import now_ns
    from ..health.events.audit import BEGUN, AuditEntry
    from ..health.events.diary import Diary
    from ..nodes.stores.diary_store import DIARY
    from ..nodes.wiring.start_entry import user_name

    if folder is None:
        click.echo("this stands in no audit log; --history names the folder of one", err=True)
        yield
        return
    path = folder / DIARY
    if not path.is_file():
        raise InputError(f"{path}: there is no audit log; the first start of the service makes it")
    request = secrets.token_hex(6)
    with closing(Diary(path)) as diary:

        def note(outcome: str) -> None:
            at_ns = now_ns()
            entry = AuditEntry(
                time_ns=at_ns,
                who=user_name(),
                origin="command line",
                action=action,
                target=target,
                outcome=outcome,
                data={"request": request},
            )
            diary.add((), at_ns, (entry,))

        note(BEGUN)
        if diary.problem:
            raise InputError(f"{path}: the audit log cannot be written: {diary.problem}")
        try:
            yield
        except Exception as error:
            note(f"refused: {error}")
            raise
        note("done")
