"""Access to the plant's bus, as a configuration asks for it."""

from ....broker_tls import BrokerTlsError, broker_tls
from ....bus.plant.session import PlantSettings, PlantSettingsError
from ....bus.settings import TlsSettings
from ....config import ConfigError
from ....config_tables import PlantAccess


def plant_settings(access: PlantAccess, table: str = "plant") -> PlantSettings:
    """Settings of a session, with files that can be used. Raises ConfigError.

    Args:
        table: name of the table, for mistakes in it.
    """
    files = access.ca_certificate, access.client_certificate, access.client_key
    try:
        broker_tls(*files)
        authority, certificate, key = files
        certificates = None
        if authority is not None and certificate is not None and key is not None:
            certificates = TlsSettings(access.endpoint, authority, certificate, key)
        return PlantSettings(access.endpoint, certificates, access.allow_plain)
    except (BrokerTlsError, PlantSettingsError) as error:
        raise ConfigError(f"{table}.{error}") from None
