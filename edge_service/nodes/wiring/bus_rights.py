"""Part of each process in the bus, as the configuration asks for it."""

import logging
from datetime import UTC, datetime, timedelta
from pathlib import Path

from ...bus.access import READER
from ...bus.settings import BusSettings, TlsSettings
from ...config import BusConfig, ConfigError, EdgeConfig
from ...secret_files import SecretError, read_secret

log = logging.getLogger(__name__)
_SOON_DAYS = 30.0
_SOON = "%s: the certificate expires in %.0f days; run `edge-service certs` again and restart"


def router_settings(config: EdgeConfig) -> BusSettings:
    """Settings of the process that is the bus' router. Raises ConfigError."""
    bus = config.bus
    if bus.security == "open":
        log.warning("the bus is open: any process on this machine can forge a preload")
    tls = None if bus.certificates is None else _tls(bus, "server")
    return BusSettings(bus.endpoint, "router", bus.security, tls)


def node_settings(config: EdgeConfig, name: str) -> BusSettings:
    """Settings of one node in a process of its own; `bus` is the router. Raises ConfigError."""
    config = _with_certificates(config)
    bus = config.bus
    if name == "bus":
        return router_settings(config)
    tls = None if bus.certificates is None else _tls(bus, name)
    return BusSettings(bus.endpoint, "client", bus.security, tls)


def reader_settings(config: EdgeConfig) -> BusSettings:
    """Settings of a process that only reads. Raises ConfigError."""
    bus = config.bus
    tls = _tls(bus, READER) if bus.security == "tls" else None
    return BusSettings(bus.endpoint, "client", bus.security, tls)


def _with_certificates(config: EdgeConfig) -> EdgeConfig:
    """The configuration; nodes that are given no certificates make their own. ConfigError."""
    if config.bus.certificates is not None or config.bus.security == "open":
        return config
    from ...certificates import CertificateError  # 8 MB, which an open bus does without
    from .own_certificates import own_certificates

    try:
        folder = own_certificates(config)
    except (CertificateError, OSError) as error:
        raise ConfigError(
            f"bus.certificates: there are none, and they cannot be created ({error})"
        ) from None
    bus = config.bus.model_copy(update={"certificates": folder})
    return config.model_copy(update={"bus": bus})


def _tls(bus: BusConfig, name: str) -> TlsSettings:
    from ...certificates import CertificateError, expiry

    assert bus.certificates is not None
    try:
        tls = TlsSettings.of_folder(bus.secure_endpoint, bus.certificates, name)
        read_secret(tls.key)  # which others must not be able to read
        warn_if_soon(tls.certificate, expiry(tls.certificate))
        return tls
    except (SecretError, CertificateError) as error:
        raise ConfigError(f"bus.certificates: {error}") from None
    except OSError as error:
        raise ConfigError(f"bus.certificates: {error.filename}: {error.strerror}") from None


def warn_if_soon(certificate: Path, end: datetime) -> None:
    """Tell that a certificate ends within a month: afterwards nobody is let in by it."""
    days = (end - datetime.now(UTC)) / timedelta(days=1)
    if days < _SOON_DAYS:
        log.warning(_SOON, certificate, days)
