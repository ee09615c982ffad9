"""The words on the wire: frozen, SI units, no knowledge of any other room."""
