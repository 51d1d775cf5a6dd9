# SPDX-License-Identifier: Apache-2.0
"""Tracks corners from frame to frame, as the front end of a SLAM program does. Usage: track.py FIFO"""

import sys

import cv2
import orbbuf

last = None
for frame in orbbuf.Pipe(sys.argv[1]):
    image = frame.pixels()
    corners = None if last is None else cv2.goodFeaturesToTrack(last, 300, 0.01, 8)
    if corners is not None:
        _, found, _ = cv2.calcOpticalFlowPyrLK(last, image, corners, None)
        print(f"frame {frame.sequence}: {int(found.sum())} of {len(corners)} corners tracked, {frame.missed} frames missed before it")
    last = image
