"""Reports of a machine to its plant, over Zenoh routers."""
