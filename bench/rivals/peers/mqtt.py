#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Frames over MQTT with QoS 1 and a persistent session: receive ADDRESS | send ADDRESS KEEPALIVE_S FOLDER BEGIN.

The client's queue has no bound, as is paho's default. With a keepalive under 10 s it also reconnects each second."""
import os
import sys
import threading

import paho.mqtt.client as mqtt

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from camera import Camera, arrived  # noqa: E402


def client(name):
    version = [mqtt.CallbackAPIVersion.VERSION1] if hasattr(mqtt, "CallbackAPIVersion") else []
    return mqtt.Client(*version, client_id=name, clean_session=False)


def receive(address):
    subscriber = client("slam")
    subscriber.on_connect = lambda *_: subscriber.subscribe("camera", 1)
    subscriber.on_message = lambda _, __, message: arrived(message.payload)
    subscriber.connect(address)
    subscriber.loop_forever(retry_first_connection=True)


def send(address, keepalive, camera):
    publisher = client("robot")
    if keepalive < 10:
        publisher.reconnect_delay_set(1, 1)
    connected = threading.Event()
    publisher.on_connect = lambda *_: connected.set()
    publisher.connect(address, keepalive=keepalive)
    publisher.loop_start()
    connected.wait()
    for message in camera.messages():
        publisher.publish("camera", message, 1)


if sys.argv[1] == "receive":
    receive(sys.argv[2])
else:
    send(sys.argv[2], int(sys.argv[3]), Camera(*sys.argv[4:]))
