"""JSON off an MQTT broker."""
