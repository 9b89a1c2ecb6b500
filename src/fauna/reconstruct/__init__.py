"""From one photograph to a rigged, textured animal: the command ``fauna-reconstruct`` and :func:`fauna.load`."""
