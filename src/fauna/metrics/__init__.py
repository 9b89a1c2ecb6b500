"""What predictions are worth: pure functions, one table (:func:`fauna.metrics.score.score`), a reason for whatever is missing.

==========================================  ==========================================================================================
key                                         definition
==========================================  ==========================================================================================
``iou``                                     silhouette against mask
``kt_pck@0.1``                              keypoint transfer between photos of a species, correct within a tenth of the crop's side;
                                            corresponding points by bone-local coordinates (``transfer.py``, ``lookup.py``)
``kt_pck@0.1_lr_free``                      the same, left and right exchanged for a whole pair where that is better
``kt_pck@0.1_shared_base[_lr_free]``        corresponding points by vertex index; needs one base mesh per species
``pck@0.1``                                 keypoints as mixtures of surface points, fitted on one half of the photos, on the other half
``pck@0.1_fit_on_test``                     fitted and tested on all photos
``pa_mpjpe``                                3D keypoints of the same map after Procrustes alignment; share of the truth's size
``chamfer``, ``f_score``, ``volume_iou``    surfaces in the camera frame, aligned in scale and depth only (``alignment.py``);
                                            the F-score's distance is 5 % of the truth's size
``..._similarity``                          the same after a rigid alignment with scale
``novel_view_iou``                          silhouettes from eight views around the truth, aligned in the camera frame
``leg_chamfer``                             each true leg against the surface that the prediction labels with that leg's bones
``azimuth_error_deg``                       with ``azimuth_within_30``, ``elevation_error_deg``: of the viewpoint
``front_back_flips``, ``left_right_flips``  shares of photos seen from the wrong end, heading to the wrong side (``camera.py``)
``global_flip``                             1 if +z is the model's tail: then all predictions were turned half round
==========================================  ==========================================================================================

The truth's size is the diagonal of its bounding box. Per species a keypoint metric is the mean over keypoints, any other the mean over
photos; overall it is the mean over species. Intervals are percentiles of a bootstrap over photos, within each species.
"""
