"""Drag torque of a screw that wore out, stage by stage, through the trend of the service."""
