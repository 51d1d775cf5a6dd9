#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Frames over plain TCP: receive PORT | send ADDRESS PORT blocking|queue|reconnect FOLDER BEGIN.

blocking: the camera waits for send(). queue: frames wait without a bound. reconnect: so, and when the peer has
acknowledged nothing for a second the connection is replaced; what the kernel held of the old one is lost."""
import os
import socket
import struct
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from camera import Camera, Waiting, arrived  # noqa: E402


def read(connection):
    stream = connection.makefile("rb")
    while len(head := stream.read(4)) == 4:
        length, = struct.unpack(">I", head)
        if len(message := stream.read(length)) < length:
            return
        arrived(message)


def receive(port):
    listener = socket.create_server(("", int(port)))
    while True:
        threading.Thread(target=read, args=(listener.accept()[0],), daemon=True).start()


def connect(to):
    while True:
        try:
            connection = socket.create_connection(to, timeout=1)
            connection.settimeout(None)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return connection
        except OSError:
            time.sleep(0.1)


def send(connection, message):
    connection.sendall(struct.pack(">I", len(message)) + message)


def send_reconnecting(to, waiting):
    while True:
        connection = connect(to)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 1000)
        connection.setsockopt(socket.IPPROTO_TCP, 25, 65536)  # TCP_NOTSENT_LOWAT: little to be lost
        try:
            while True:
                send(connection, waiting.first())
                waiting.drop_first()
        except OSError:
            connection.close()


def main():
    if sys.argv[1] == "receive":
        receive(sys.argv[2])
    address, port, mode, folder, begin = sys.argv[2:]
    camera, to = Camera(folder, begin), (address, int(port))
    if mode == "reconnect":
        send_reconnecting(to, Waiting(camera))
    connection = connect(to)
    for message in Waiting(camera) if mode == "queue" else camera.messages():
        send(connection, message)


main()
