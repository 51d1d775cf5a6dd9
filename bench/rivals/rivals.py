# SPDX-License-Identifier: Apache-2.0
"""The products and settings of the bench: how each is started on the server's host and on the robot's.

Commands are of the shell; the last of the server's prints the arrivals. {server} and {robot} are the hosts'
addresses, {camera} the arguments of camera.py, {peers} and {bin} where our peers are, {work} a folder of the run,
which gets `files`. needs: program:NAME, python:MODULE, gst:ELEMENT or peer:NAME (orbbuf-rival-NAME, which is built
where Debian has the library)."""
import dataclasses

NOTHING = "nothing"


@dataclasses.dataclass
class Rival:
    name: str
    setting: str
    server: list
    robot: list
    needs: list = dataclasses.field(default_factory=list)
    files: dict = dataclasses.field(default_factory=dict)
    tells: str = NOTHING  # what says which frames are missing
    drain_s: int = 0  # what comes another way than the live stream needs so long at the end
    is_orbbuf: bool = False  # its peer prints names of images, and frames are numbered from the robot's log


ORBBUF_SERVER = "{build}/server/orbbuf-server --set listen.address={server}:7722 --set files.path={work}/frames"
ORBBUF_ROBOT = ("{build}/daemon/orbbufd --set link.server={server}:7722 --set source.kind=folder --set source.path={images} "
                "--set source.fps=25 --set source.loop=true --set 'link.drain_timeout=1 s' --set log.level=debug")
WATCH = "until ls -d {work}/frames/*/*/images >/dev/null 2>&1; do sleep 0.1; done; " \
        "exec {bin}/orbbuf-link-peer watch {work}/frames/*/*/images"


def orbbuf(name, setting, server="--set listen.insecure=true", robot="--set robot.id=r", **more):
    return Rival(name, setting, [f"{ORBBUF_SERVER} {server}", WATCH], [f"{ORBBUF_ROBOT} {robot}"],
                 tells="each frame and the reason, in drops.csv", is_orbbuf=True, **more)


def tcp(name, setting, mode):
    return Rival(name, setting, ["{peers}/tcp.py receive 5001"], ["{peers}/tcp.py send {server} 5001 " + mode + " {camera}"])


def ros(name, setting, queue):
    env = "ROS_MASTER_URI=http://{server}:11311 ROS_HOME={work} ROS_LOG_DIR={work} ROS_IP="
    return Rival(name, setting,
                 [env + "{server} rosmaster --core -p 11311",
                  "sleep 2; " + env + "{server} exec {bin}/orbbuf-rival-ros receive " + queue],
                 ["sleep 2; {peers}/../camera.py {camera} | " + env + "{robot} {bin}/orbbuf-rival-ros send " + queue],
                 ["program:rosmaster", "peer:ros"], tells="the count: gaps in header.seq")


def cyclone(name, setting, history, lease="", queue=""):
    xml = ("CYCLONEDDS_URI='<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast></General><Discovery>"
           "<ParticipantIndex>auto</ParticipantIndex><Peers><Peer address=\"PEER\"/></Peers>" +
           (f"<LeaseDuration>{lease}</LeaseDuration>" if lease else "") + "</Discovery></Domain></CycloneDDS>' ")
    return Rival(name, setting, [xml.replace("PEER", "{robot}") + "exec {bin}/orbbuf-rival-cyclone receive " + history],
                 ["{peers}/../camera.py {camera} " + queue + " | " + xml.replace("PEER", "{server}") +
                  "{bin}/orbbuf-rival-cyclone send " + history + (" wait" if queue else "")], ["peer:cyclone"], tells="the count: sample lost")


def fast_dds(name, setting, history, lease="", queue=""):
    return Rival(name, setting, ["exec {bin}/orbbuf-rival-fast-dds receive " + history + " {robot} " + lease],
                 ["{peers}/../camera.py {camera} " + queue + " | {bin}/orbbuf-rival-fast-dds send " + history +
                  " {server} " + lease], ["peer:fast-dds"], tells="the count: sample lost")


BROKER = "listener 1883 0.0.0.0\nallow_anonymous true\nuser root\n"
BRIDGE = (BROKER + "max_queued_messages 0\nmax_inflight_messages 0\nconnection server\naddress 10.78.0.2\ntopic camera out 1\n"
          "cleansession false\nrestart_timeout 1\nkeepalive_interval 5\n")


def mqtt(name, setting, keepalive):
    return Rival(name, setting,
                 ["mosquitto -c {work}/mosquitto.conf", "sleep 1; exec {peers}/mqtt.py receive {server}"],
                 ["sleep 1; exec {peers}/mqtt.py send {server} " + keepalive + " {camera}"],
                 ["program:mosquitto", "python:paho.mqtt.client"], {"mosquitto.conf": BROKER})


def mqtt_bridge(name, setting):
    return Rival(name, setting,
                 ["mosquitto -c {work}/mosquitto.conf", "sleep 1; exec {peers}/mqtt.py receive {server}"],
                 ["mosquitto -c {work}/bridge.conf", "sleep 1; exec {peers}/mqtt.py send 127.0.0.1 60 {camera}"],
                 ["program:mosquitto", "python:paho.mqtt.client"], {"mosquitto.conf": BROKER, "bridge.conf": BRIDGE})


def nats(name, setting, mode):
    return Rival(name, setting,
                 ["nats-server -a {server} -js -sd {work}/nats", "exec {bin}/orbbuf-rival-nats receive nats://{server}"],
                 ["sleep 1; {peers}/../camera.py {camera} " + ("queue" if mode == "best" else "") +
                  " | {bin}/orbbuf-rival-nats send nats://{server} " + mode], ["program:nats-server", "peer:nats"])


def websocket(name, setting, length):
    return Rival(name, setting, ["exec {peers}/websocket.py receive ws://{robot}:8765"],
                 ["exec {peers}/websocket.py send 8765 " + length + " {camera}"], ["python:websockets"])


def gst(name, setting, kind, *elements, host="{server}", tells="the count of packets: RTP's numbers"):
    return Rival(name, setting, [f"exec {{peers}}/gst.py receive {kind} {host}"],
                 [f"sleep 1; exec {{peers}}/gst.py send {kind} {host} {{camera}}"],
                 ["python:gi", "gst:appsrc", "gst:rtpjpegpay"] + ["gst:" + e for e in elements], tells=tells)


# What is asked for and Debian does not have.
ABSENT = {
    "foxglove_bridge": "not in Debian; websocket_1024 has its rule for the queue",
    "zenoh": "neither zenoh, zenoh-pico nor rmw_zenoh is in Debian",
    "livekit": "not in Debian",
}

RIVALS = [
    orbbuf("orbbuf", "ORBBuf, defaults"),
    orbbuf("orbbuf_spool", "ORBBuf, with a spool", robot="--set robot.id=r --set spool.path={work}/spool", drain_s=90),
    orbbuf("orbbuf_tls", "ORBBuf, over TLS", server="{tls_server}", robot="{tls_robot}"),
    tcp("tcp_blocking", "plain TCP, the camera waits for send()", "blocking"),
    tcp("tcp_queue", "plain TCP, queue without a bound", "queue"),
    tcp("tcp_reconnect", "plain TCP, user timeout of 1 s, reconnects, keeps all", "reconnect"),
    ros("roscpp_10", "roscpp, queue of 10", "10"),
    ros("roscpp_all", "roscpp, queue without a bound", "0"),
    cyclone("cyclone_best_effort", "Cyclone DDS, best effort", "best-effort"),
    cyclone("cyclone_last_10", "Cyclone DDS, reliable, KEEP_LAST 10", "10"),
    cyclone("cyclone_all", "Cyclone DDS, reliable, KEEP_ALL", "all"),
    cyclone("cyclone_all_lease", "Cyclone DDS, KEEP_ALL, lease of an hour, queue before it", "all", "3600s", "queue"),
    fast_dds("fast_dds_best_effort", "Fast DDS, best effort", "best-effort"),
    fast_dds("fast_dds_last_10", "Fast DDS, reliable, KEEP_LAST 10", "10"),
    fast_dds("fast_dds_all", "Fast DDS, reliable, KEEP_ALL", "all"),
    fast_dds("fast_dds_all_lease", "Fast DDS, KEEP_ALL, lease of an hour, queue before it", "all", "3600", "queue"),
    mqtt("mqtt_qos1", "mosquitto, QoS 1, persistent session", "60"),
    mqtt("mqtt_qos1_keepalive_5", "mosquitto, QoS 1, keepalive of 5 s", "5"),
    mqtt_bridge("mqtt_bridge", "mosquitto as a bridge on the robot"),
    gst("gst_udp", "GStreamer, RTP over UDP", "udp"),
    gst("gst_srt_120", "GStreamer, SRT, latency of 120 ms", "srt-120", "srtsink"),
    gst("gst_srt_2000", "GStreamer, SRT, latency of 2 s", "srt-2000", "srtsink"),
    gst("gst_rist_1000", "GStreamer, RIST, buffer of 1 s", "rist-1000", "ristsink"),
    gst("gst_rist_4000", "GStreamer, RIST, buffer of 4 s", "rist-4000", "ristsink"),
    gst("gst_webrtc", "GStreamer, WebRTC, H.264", "webrtc", "webrtcbin", "x264enc", "nicesrc"),
    gst("gst_rtsp", "GStreamer, RTSP over TCP", "rtsp", "rtspsrc", host="{robot}"),
    gst("gst_rtsp_reconnect", "GStreamer, RTSP over TCP, reconnects", "rtsp-reconnect", "rtspsrc", host="{robot}"),
    nats("nats", "NATS JetStream, defaults", "defaults"),
    nats("nats_best", "NATS JetStream, asynchronous, reconnects", "best"),
    websocket("websocket_1024", "WebSocket, drops the oldest of 1024", "1024"),
    websocket("websocket_10", "WebSocket, drops the oldest of 10", "10"),
]
