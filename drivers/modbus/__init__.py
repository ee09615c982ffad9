"""Modbus TCP: holding and input registers polled in groups; and a stub device."""
