"""A configured cell: configuration, plan job, engine, runner, records."""
