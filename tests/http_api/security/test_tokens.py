"""Tokens: kept as hashes, for their owner alone, ended by revocation and by time."""

import hashlib
from datetime import timedelta
from pathlib import Path

import pytest

from edge_service.http_api.security.tokens import (
    TokenError,
    TokenFile,
    add_token,
    digest,
    read_tokens,
    revoke_token,
    utc,
)

NOW = utc(1_769_860_800_000_000_000)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "tokens.json"


def test_the_file_holds_a_hash_and_not_the_secret(path: Path) -> None:
    secret = add_token(path, "kim", "operator", 30, NOW)
    assert secret not in path.read_text()
    assert hashlib.sha256(secret.encode()).hexdigest() in path.read_text()
    assert path.stat().st_mode & 0o777 == 0o600


def test_secrets_are_long_and_never_the_same(path: Path) -> None:
    secrets = {add_token(path, f"n{number}", "viewer", 1, NOW) for number in range(20)}
    assert len(secrets) == 20
    assert min(map(len, secrets)) >= 43


def test_a_token_holds_until_it_ends(path: Path) -> None:
    sha256 = digest(add_token(path, "kim", "admin", 30, NOW))
    tokens = TokenFile(path)
    assert tokens.find(sha256, NOW + timedelta(days=30, microseconds=-1))
    assert tokens.find(sha256, NOW + timedelta(days=30)) is None


def test_what_is_revoked_or_added_counts_at_once(path: Path) -> None:
    kept, gone = (digest(add_token(path, name, "viewer", 1, NOW)) for name in ("kept", "gone"))
    tokens = TokenFile(path)
    assert tokens.find(gone, NOW)
    revoke_token(path, "gone")
    late = digest(add_token(path, "late", "viewer", 1, NOW))
    assert tokens.find(gone, NOW) is None
    assert tokens.find(kept, NOW)
    assert tokens.find(late, NOW)
    assert path.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("name", ["", " x", "a\nb", "x" * 61, "a/b", "<b>", "\x1b[1m"])
def test_a_name_that_makes_no_sense_is_refused(name: str, path: Path) -> None:
    with pytest.raises(TokenError, match="expected up to 60 letters"):
        add_token(path, name, "viewer", 1, NOW)
    assert not path.exists()


def test_a_name_is_given_once(path: Path) -> None:
    add_token(path, "kim", "viewer", 1, NOW)
    with pytest.raises(TokenError, match="there is already a token named 'kim'"):
        add_token(path, "kim", "admin", 1, NOW)


def test_an_unknown_name_is_told_with_those_there_are(path: Path) -> None:
    add_token(path, "kim", "viewer", 1, NOW)
    with pytest.raises(TokenError, match="no token named 'kin'; there are: kim"):
        revoke_token(path, "kin")


@pytest.mark.parametrize(
    "content",
    [b"", b"[]", b"{", b"\xff", b'{"schema": "tokens/2", "tokens": []}', b'{"tokens": [{}]}'],
)
def test_a_damaged_file_is_named_and_lets_nobody_in(content: bytes, path: Path) -> None:
    sha256 = digest(add_token(path, "kim", "viewer", 1, NOW))
    tokens = TokenFile(path)
    assert tokens.find(sha256, NOW)
    path.write_bytes(content)
    for read in (lambda: read_tokens(path), lambda: tokens.find(sha256, NOW)):
        with pytest.raises(
            TokenError, match=r"tokens\.json: is not a file written by `edge-service token`"
        ):
            read()


def test_a_file_that_is_gone_lets_nobody_in(path: Path) -> None:
    sha256 = digest(add_token(path, "kim", "viewer", 1, NOW))
    tokens = TokenFile(path)
    assert tokens.find(sha256, NOW)
    path.unlink()
    with pytest.raises(TokenError, match="cannot be read"):
        tokens.find(sha256, NOW)


@pytest.mark.parametrize("mode", [0o620, 0o602, 0o666])
def test_a_file_that_others_may_write_is_refused(mode: int, path: Path) -> None:
    add_token(path, "kim", "viewer", 1, NOW)
    path.chmod(mode)
    with pytest.raises(TokenError, match="others may write to it"):
        read_tokens(path)
