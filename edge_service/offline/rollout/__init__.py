"""Roll-outs: signed bundles of configurations for the machines of a site, put in place whole."""
