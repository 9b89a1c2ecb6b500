"""What predictions are worth: pure functions, one table (:func:`fauna.metrics.score.score`), a reason for whatever is missing.

The meaning of every key stands in :data:`fauna.metrics.keys.DEFINITIONS`; the modules say how it is computed: ``iou.py``;
``transfer.py`` with ``lookup.py`` (corresponding points by bone-local coordinates) for ``kt_pck``; ``keypoint_map.py`` for ``pck`` and
``pa_mpjpe``; ``surface.py``, ``alignment.py`` and ``novel_view.py`` for 3D; ``camera.py`` for the viewpoint.

Per species a keypoint metric is the mean over keypoints, any other the mean over photos; overall it is the mean over species.
Intervals are percentiles of a bootstrap over photos, within each species (``tally.py``).
"""
