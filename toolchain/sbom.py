#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Prints an SBOM (SPDX 2.3, JSON) of the packages in POOL/CODENAME: each with its sums, its dependencies as dpkg has
them, and the header-only libraries that its build compiled in, with the versions of the Debian that built it.

Usage: sbom.py VERSION EPOCH POOL
"""
import datetime
import hashlib
import json
import pathlib
import re
import subprocess
import sys

COMPILED_IN = ("libboost-dev", "libcli11-dev", "libtomlplusplus-dev", "nlohmann-json3-dev")
ROOT = pathlib.Path(__file__).parent.parent


def field(deb, name):
    return subprocess.run(("dpkg-deb", "-f", deb, name), check=True, capture_output=True, text=True).stdout.strip()


def compiled_in(codename):
    """Of this machine, or of the root in which ./dev --release builds."""
    root = ROOT / f"build/root-{codename}"
    database = root / "var/lib/dpkg" if root.exists() else pathlib.Path("/var/lib/dpkg")
    shown = subprocess.run(("dpkg-query", f"--admindir={database}", "-W", "-f=${Package} ${Version}\n", *COMPILED_IN),
                           capture_output=True, text=True).stdout
    return [tuple(line.split()) for line in shown.splitlines() if len(line.split()) == 2]


def sbom(version, epoch, pool):
    packages, relations = {}, []

    def add(name, package_version, codename, namespace="debian", **more):
        key = "SPDXRef-" + re.sub(r"[^A-Za-z0-9.-]", "-", f"{codename}-{name}-{package_version}-{more.pop('arch', '')}").rstrip("-")
        at = f"@{package_version}" if package_version else ""
        packages.setdefault(key, {
            "SPDXID": key, "name": name, **({"versionInfo": package_version} if package_version else {}),
            "downloadLocation": "NOASSERTION", "filesAnalyzed": False, "copyrightText": "NOASSERTION",
            "licenseConcluded": "NOASSERTION", "licenseDeclared": "NOASSERTION",
            "externalRefs": [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl",
                              "referenceLocator": f"pkg:deb/{namespace}/{name}{at}?distro={codename}"}], **more})
        return key

    for deb in sorted(pool.glob("*/*.deb")):
        codename = deb.parent.name
        ours = add(field(deb, "Package"), field(deb, "Version"), codename, "orbbuf", arch=field(deb, "Architecture"),
                   packageFileName=deb.name, licenseDeclared="Apache-2.0",
                   checksums=[{"algorithm": "SHA256", "checksumValue": hashlib.sha256(deb.read_bytes()).hexdigest()}])
        relations.append(("SPDXRef-DOCUMENT", "DESCRIBES", ours))
        for dependency in filter(None, re.split(r"[,|]\s*", field(deb, "Depends"))):
            name, least = re.fullmatch(r"([^\s:(]+)(?::\w+)?\s*(?:\([<>=]+ ([^)]+)\))?\s*", dependency).groups()
            more = {"comment": f"at least {least}"} if least else {}
            relations.append((ours, "DEPENDS_ON", add(name, "", codename, **more)))
        if field(deb, "Architecture") != "all":
            for name, its in compiled_in(codename):
                relations.append((ours, "STATIC_LINK", add(name, its, codename)))
    created = datetime.datetime.fromtimestamp(epoch, datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    return {"spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT",
            "name": f"orbbuf-{version}", "documentNamespace": f"https://orbbuf.invalid/spdx/{version}-{epoch}",
            "creationInfo": {"created": created, "creators": ["Tool: toolchain/sbom.py"]},
            "packages": list(packages.values()),
            "relationships": [dict(zip(("spdxElementId", "relationshipType", "relatedSpdxElement"), relation))
                              for relation in relations]}


print(json.dumps(sbom(sys.argv[1], int(sys.argv[2]), pathlib.Path(sys.argv[3])), indent=1))
