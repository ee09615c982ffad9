"""JSON off an MQTT broker: the capture of Industrial Edge, or any other by a map of members."""
