"""The operator's page: the rig in a browser, by the same orchestration that the command line calls. Verb `serve`."""
