"""Readers of published keypoint datasets: photographs with boxes, masks and keypoints, cut by the project's own crop rule."""
