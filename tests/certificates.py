"""An authority for the tests, and what it issues."""

from pathlib import Path

import trustme


def write_certificates(folder: Path, *names: str) -> tuple[Path, Path]:
    """Write `ca.pem`, `server.pem` and `server.key`; returns the last two.

    Args:
        names: host names and addresses of the server, besides those of loopback.
    """
    authority = trustme.CA()
    issued = authority.issue_cert("localhost", "127.0.0.1", "::1", *names)
    authority.cert_pem.write_to_path(folder / "ca.pem")
    certificate, key = folder / "server.pem", folder / "server.key"
    issued.private_key_pem.write_to_path(key)
    key.chmod(0o600)
    for part in issued.cert_chain_pems:
        part.write_to_path(certificate, append=True)
    return certificate, key
