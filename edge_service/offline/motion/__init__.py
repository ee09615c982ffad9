"""`edge-service motion`: motions for a controller, which of them decides, what one can show."""
