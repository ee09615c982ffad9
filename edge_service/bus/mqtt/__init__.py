"""Messages of the bus to an MQTT broker: spooled on disk, in order, in three forms."""
