"""What leaves a machine for its plant, over Zenoh routers."""
