#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Frames over a WebSocket, served by the robot as foxglove_bridge does: each viewer has a queue of LENGTH frames, of
which the oldest is dropped: receive URL | send PORT LENGTH FOLDER BEGIN."""
import asyncio
import collections
import os
import sys
import threading

import websockets

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from camera import Camera, arrived  # noqa: E402


async def receive(url):
    while True:
        try:
            async with websockets.connect(url, max_size=None, open_timeout=2, compression=None) as socket:
                async for message in socket:
                    arrived(message)
        except (OSError, asyncio.TimeoutError, websockets.WebSocketException):
            await asyncio.sleep(0.5)


class Viewers:
    def __init__(self, length):
        self.length = length
        self.queues = []

    def offer(self, message):
        for queue, some in self.queues:
            queue.append(message)
            some.set()

    async def serve(self, socket):
        viewer = collections.deque(maxlen=self.length), asyncio.Event()
        self.queues.append(viewer)
        queue, some = viewer
        try:
            while True:
                await some.wait()
                some.clear()
                while queue:
                    await socket.send(queue.popleft())
        finally:
            self.queues.remove(viewer)


async def send(port, length, camera):
    viewers, loop = Viewers(length), asyncio.get_running_loop()

    def capture():
        for message in camera.messages():
            loop.call_soon_threadsafe(viewers.offer, message)

    threading.Thread(target=capture, daemon=True).start()
    async with websockets.serve(lambda socket, *_: viewers.serve(socket), "", int(port), compression=None):
        await asyncio.Future()


if sys.argv[1] == "receive":
    asyncio.run(receive(sys.argv[2]))
else:
    asyncio.run(send(sys.argv[2], int(sys.argv[3]), Camera(*sys.argv[4:])))
