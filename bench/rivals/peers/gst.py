#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Frames over what GStreamer ships: send KIND ADDRESS FOLDER BEGIN | receive KIND ADDRESS.

KIND: udp, srt-MS, rist-MS, rtsp, rtsp-reconnect, webrtc. ADDRESS is the host that listens: the server, with rtsp
the robot. JPEG goes by RTP; a received frame is recognised by its coded pixels, since RTP takes the headers off: a
line `image TIME CRC`. WebRTC carries H.264, whose frames are recognised by their RTP times: NUMBER TIME -, when a
frame and all that it refers to is there."""
import json
import os
import socket
import sys
import threading
import time

import gi

for name in ("Gst", "GstApp", "GstRtp", "GstRtspServer", "GstWebRTC", "GstSdp"):
    gi.require_version(name, "1.0")
from gi.repository import GLib, Gst, GstApp, GstRtp, GstRtspServer, GstSdp, GstWebRTC  # noqa: E402, F401

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from camera import FPS, Camera, crc_of_pixels  # noqa: E402

PORT = 5004
SOURCE = "appsrc name=camera is-live=true format=time caps=image/jpeg,width=528,height=400,framerate=25/1"
PAY = "rtpjpegpay timestamp-offset=0"
RTP = "application/x-rtp,media=video,encoding-name=JPEG,clock-rate=90000,payload=26"
SINK = "appsink name=sink sync=false emit-signals=true"
H264 = "application/x-rtp,media=video,encoding-name=H264,clock-rate=90000,payload=96"


def transport(kind, address):
    """What sends and what receives, of the kinds that are one pipeline."""
    kind, _, ms = kind.partition("-")
    if kind == "udp":
        return f"udpsink host={address} port={PORT}", f'udpsrc port={PORT} caps="{RTP}"'
    if kind == "srt":
        return (f"srtsink uri=srt://{address}:{PORT}?mode=caller latency={ms}",
                f'srtsrc uri=srt://:{PORT}?mode=listener latency={ms} keep-listening=true ! {RTP}')
    return (f"ristsink address={address} port={PORT} sender-buffer={int(ms) * 12 // 10}",
            f"ristsrc port={PORT} receiver-buffer={ms} ! {RTP}")


def fail_at_errors(pipeline, at_end=lambda: os._exit(1)):
    def seen(_, message):
        if message.type == Gst.MessageType.ERROR:
            print(message.parse_error(), file=sys.stderr, flush=True)
        at_end()

    bus = pipeline.get_bus()
    bus.add_signal_watch()
    bus.connect("message::error", seen)
    bus.connect("message::eos", seen)


def capture(source, camera, is_stamped=True):
    for number, jpeg in camera:
        frame = Gst.Buffer.new_wrapped(jpeg)
        if is_stamped:
            frame.pts = number * Gst.SECOND // FPS
        source.push_buffer(frame)


def begin(pipeline, camera):
    """Starts it so that its running time is the time since the camera's begin."""
    source = pipeline.get_by_name("camera")
    clock = Gst.SystemClock.obtain()
    pipeline.use_clock(clock)
    pipeline.set_start_time(Gst.CLOCK_TIME_NONE)
    pipeline.set_base_time(clock.get_time() - int((time.time() - camera.begin) * Gst.SECOND))
    pipeline.set_state(Gst.State.PLAYING)
    threading.Thread(target=capture, args=(source, camera), daemon=True).start()


def on_jpeg(sink):
    frame = sink.emit("pull-sample").get_buffer()
    print("image", f"{time.time():.6f}", crc_of_pixels(frame.extract_dup(0, frame.get_size())), flush=True)
    return Gst.FlowReturn.OK


def receive_jpeg(pipeline):
    pipeline.get_by_name("sink").connect("new-sample", on_jpeg)
    fail_at_errors(pipeline)
    pipeline.set_state(Gst.State.PLAYING)


def serve_rtsp(camera):
    server = GstRtspServer.RTSPServer(service="8554")
    factory = GstRtspServer.RTSPMediaFactory(shared=True)
    factory.set_launch(f"( {SOURCE} do-timestamp=true ! {PAY} name=pay0 pt=26 )")

    def configure(_, media):
        source = media.get_element().get_by_name("camera")
        threading.Thread(target=capture, args=(source, camera, False), daemon=True).start()

    factory.connect("media-configure", configure)
    server.get_mount_points().add_factory("/camera", factory)
    server.attach()
    return server


def play_rtsp(address, reconnect):
    pipeline = Gst.parse_launch(f"rtspsrc location=rtsp://{address}:8554/camera protocols=tcp name=source "
                                f"! rtpjpegdepay ! {SINK}")
    if reconnect:
        pipeline.get_by_name("source").set_property("tcp-timeout", 2_000_000)

    def again():
        if reconnect or not has_played:
            pipeline.set_state(Gst.State.NULL)
            GLib.timeout_add(200, lambda: play_rtsp(address, reconnect))

    def on_frame(sink):
        has_played.append(True)
        return on_jpeg(sink)

    has_played = []
    pipeline.get_by_name("sink").connect("new-sample", on_frame)
    fail_at_errors(pipeline, again)
    pipeline.set_state(Gst.State.PLAYING)


class WebRtc:
    """One end; SDP and candidates go over a TCP connection, before any outage."""

    def __init__(self, connection, pipeline):
        self.stream = connection.makefile("rw")
        self.pipeline = pipeline
        self.end = pipeline.get_by_name("rtc")
        self.end.connect("on-ice-candidate", lambda _, line, text: self.tell(line=line, candidate=text))
        fail_at_errors(pipeline)
        threading.Thread(target=self.listen, daemon=True).start()

    def tell(self, **what):
        self.stream.write(json.dumps(what) + "\n")
        self.stream.flush()

    def listen(self):
        for line in self.stream:
            GLib.idle_add(self.take, json.loads(line))

    def take(self, told):
        if "candidate" in told:
            self.end.emit("add-ice-candidate", told["line"], told["candidate"])
            return
        _, sdp = GstSdp.SDPMessage.new_from_text(told["sdp"])
        is_offer = told["type"] == "offer"
        kind = GstWebRTC.WebRTCSDPType.OFFER if is_offer else GstWebRTC.WebRTCSDPType.ANSWER
        description = GstWebRTC.WebRTCSessionDescription.new(kind, sdp)
        self.end.emit("set-remote-description", description, None)
        if is_offer:
            self.describe("answer")

    def describe(self, kind):
        def made(promise):
            promise.wait()
            reply = promise.get_reply()  # owns the description
            description = reply.get_value(kind)
            self.end.emit("set-local-description", description, None)
            self.tell(type=kind, sdp=description.sdp.as_text())

        self.end.emit("create-" + kind, None, Gst.Promise.new_with_change_func(made))


def send_webrtc(address, camera):
    while True:
        try:
            connection = socket.create_connection((address, 8443))
            break
        except OSError:
            time.sleep(0.2)
    pipeline = Gst.parse_launch(
        f"webrtcbin name=rtc {SOURCE} ! jpegdec ! videoconvert ! x264enc tune=zerolatency speed-preset=ultrafast "
        f"bitrate=6000 ! video/x-h264,profile=constrained-baseline ! rtph264pay timestamp-offset=0 config-interval=-1 "
        f"aggregate-mode=zero-latency ! {H264} ! rtc.")
    rtc = WebRtc(connection, pipeline)
    rtc.end.connect("on-negotiation-needed", lambda _: rtc.describe("offer"))
    begin(pipeline, camera)


def on_h264(sink, newest):
    sink.emit("pull-sample")
    print(round(newest[0] * FPS / 90000), f"{time.time():.6f}", "-", flush=True)
    return Gst.FlowReturn.OK


def receive_webrtc():
    connection = socket.create_server(("", 8443)).accept()[0]
    pipeline = Gst.Pipeline()
    pipeline.add(Gst.ElementFactory.make("webrtcbin", "rtc"))
    rtc, newest = WebRtc(connection, pipeline), [0]

    def remember(_, info):
        mapped, packet = GstRtp.RTPBuffer.map(info.get_buffer(), Gst.MapFlags.READ)
        if mapped:
            newest[0] = packet.get_timestamp()
            packet.unmap()
        return Gst.PadProbeReturn.OK

    def on_stream(_, pad):
        if pad.get_direction() != Gst.PadDirection.SRC:
            return
        branch = Gst.parse_bin_from_description(
            f"rtph264depay name=depay wait-for-keyframe=true request-keyframe=true ! "
            f"video/x-h264,alignment=au ! {SINK}", True)
        branch.get_by_name("sink").connect("new-sample", on_h264, newest)
        branch.get_by_name("depay").get_static_pad("sink").add_probe(Gst.PadProbeType.BUFFER, remember)
        pipeline.add(branch)
        branch.sync_state_with_parent()
        pad.link(branch.get_static_pad("sink"))

    rtc.end.connect("pad-added", on_stream)
    pipeline.set_state(Gst.State.PLAYING)
    return rtc


def main():
    Gst.init(None)
    action, kind, address = sys.argv[1:4]
    keep = None  # until the end
    if action == "send":
        camera = Camera(*sys.argv[4:])
        if kind.startswith("rtsp"):
            keep = serve_rtsp(camera)
        elif kind == "webrtc":
            send_webrtc(address, camera)
        else:
            mtu = " mtu=1316" if kind.startswith("srt") else ""  # SRT's messages
            keep = Gst.parse_launch(f"{SOURCE} ! {PAY}{mtu} ! {transport(kind, address)[0]}")
            fail_at_errors(keep)
            begin(keep, camera)
    elif kind.startswith("rtsp"):
        play_rtsp(address, kind == "rtsp-reconnect")
    elif kind == "webrtc":
        keep = receive_webrtc()
    else:
        keep = Gst.parse_launch(f"{transport(kind, address)[1]} ! rtpjpegdepay ! {SINK}")
        receive_jpeg(keep)
    GLib.MainLoop().run()


main()
