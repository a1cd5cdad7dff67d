"""``make public-robots``: two arms with meshes from packages on the index, from ``init`` to a policy on the machine."""
