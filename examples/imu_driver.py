#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Sends samples of an inertial sensor to orbbufd: imu_driver.py [SOCKET [RATE]].

Replace read_sensor() with your sensor's. The line is EuRoC's: time in ns since 1970, angular velocity in rad/s,
linear acceleration in m/s^2 with gravity, in the axes of the sensor."""
import socket
import sys
import time


def read_sensor():
    return (0.0, 0.0, 0.0), (0.0, 0.0, 9.81)


def main():
    path = sys.argv[1] if len(sys.argv) > 1 else "/run/orbbufd/imu0"
    rate = float(sys.argv[2]) if len(sys.argv) > 2 else 200.0
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    while True:
        velocity, acceleration = read_sensor()
        line = ",".join(str(value) for value in (time.time_ns(), *velocity, *acceleration))
        try:
            sock.sendto(line.encode(), path)  # waits while orbbufd is busy
        except OSError:
            pass  # orbbufd is not there: try again with the next sample
        time.sleep(1 / rate)


main()
