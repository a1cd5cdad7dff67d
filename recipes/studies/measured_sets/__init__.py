"""One module a measured machine, each with ``judge(data) -> rows``; its model and problem lie in ``envs/measured``."""
