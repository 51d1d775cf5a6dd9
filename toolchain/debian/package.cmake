# SPDX-License-Identifier: Apache-2.0
# The Debian packages: one for each component of what the folders install.
include(GNUInstallDirs)
set(debian ${PROJECT_SOURCE_DIR}/toolchain/debian)
set(made ${PROJECT_BINARY_DIR}/debian)
set(CPACK_PACKAGE_CONTACT "ORBBuf maintainers <maintainers@users.noreply.h-seed-9b03b2c3.example>")
# Of the release that it is built on and for, such that those of a later release are newer: 1~deb12u1.
# Not asked of cmake_host_system_information(), which reads the sysroot's file.
file(STRINGS /etc/os-release distribution REGEX "^ID=")
string(REGEX REPLACE "^ID=\"?([a-z]*).*" "\\1" distribution "${distribution}")
string(REGEX REPLACE "^(debian|raspbian)$" deb distribution "${distribution}")
file(STRINGS /etc/os-release release REGEX "^VERSION_ID=")
string(REGEX REPLACE "[^0-9.]" "" release "${release}")
set(CPACK_DEBIAN_PACKAGE_RELEASE 1~${distribution}${release}u1)

set(programs)
if(ORBBUF_DAEMON)
  list(APPEND programs orbbufd)
endif()
if(ORBBUF_SERVER)
  list(APPEND programs orbbuf-server)
endif()

foreach(component ${programs} orbbuf-dev python3-orbbuf)
  set(changelog ${PROJECT_SOURCE_DIR}/CHANGELOG.md)
  orbbuf_compressed(${made}/${component}/changelog.Debian.gz ${changelog} ${debian}/changelog.sh ${changelog} ${component}
             ${CPACK_DEBIAN_PACKAGE_RELEASE} ${CPACK_PACKAGE_CONTACT})
  install(FILES ${made}/${component}/changelog.Debian.gz ${debian}/copyright
          DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${component} COMPONENT ${component})
endforeach()

foreach(component ${programs})
  set(conffiles /etc/orbbuf/${component}.toml)
  if(component STREQUAL orbbuf-server)
    list(APPEND conffiles /etc/avahi/services/orbbuf-server.service)
  endif()
  list(JOIN conffiles "\n" conffiles)
  file(WRITE ${made}/${component}/conffiles "${conffiles}\n")
  set(extra ${made}/${component}/conffiles)
  foreach(script postinst prerm postrm)
    configure_file(${debian}/${script}.in ${made}/${component}/${script} @ONLY)
    list(APPEND extra ${made}/${component}/${script})
  endforeach()
  string(TOUPPER ${component} upper)
  set(CPACK_DEBIAN_${upper}_PACKAGE_CONTROL_EXTRA ${extra})
  set(CPACK_DEBIAN_${upper}_PACKAGE_SHLIBDEPS ON)
  set(CPACK_DEBIAN_${upper}_PACKAGE_SECTION net)
endforeach()

file(WRITE ${made}/python3-orbbuf/postinst
     "#!/bin/sh\nset -e\n! command -v py3compile >/dev/null || py3compile -p python3-orbbuf\n")
file(WRITE ${made}/python3-orbbuf/prerm
     "#!/bin/sh\nset -e\n! command -v py3clean >/dev/null || py3clean -p python3-orbbuf\n")
file(CHMOD ${made}/python3-orbbuf/postinst ${made}/python3-orbbuf/prerm
     PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)

set(CPACK_DEBIAN_ORBBUF-SERVER_PACKAGE_DEPENDS openssl)  # orbbuf-server add-robot
set(CPACK_DEBIAN_ORBBUF-SERVER_PACKAGE_SUGGESTS avahi-daemon)  # that orbbufd setup finds it
set(CPACK_DEBIAN_ORBBUFD_PACKAGE_SUGGESTS "avahi-utils, iw, libnss-mdns")  # that, and a server named slam.local

get_property(compressed DIRECTORY PROPERTY orbbuf_compressed)
add_custom_target(orbbuf_compressed ALL DEPENDS ${compressed})

set(CPACK_GENERATOR DEB)
set(CPACK_SET_DESTDIR ON)
set(CPACK_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_COMPONENTS_ALL ${programs} orbbuf-dev python3-orbbuf)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SOURCE orbbuf)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
if(CMAKE_LIBRARY_ARCHITECTURE STREQUAL aarch64-linux-gnu)
  set(CPACK_DEBIAN_PACKAGE_ARCHITECTURE arm64)
elseif(CMAKE_LIBRARY_ARCHITECTURE STREQUAL arm-linux-gnueabihf)
  set(CPACK_DEBIAN_PACKAGE_ARCHITECTURE armhf)
endif()
if(CMAKE_CROSSCOMPILING)
  # usr first: where lib is a link to it, the packages of libraries are listed under usr alone.
  set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${CMAKE_SYSROOT}/usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}
      ${CMAKE_SYSROOT}/lib/${CMAKE_LIBRARY_ARCHITECTURE})
endif()
set(CPACK_DEBIAN_ORBBUFD_PACKAGE_NAME orbbufd)
set(CPACK_DEBIAN_ORBBUFD_DESCRIPTION "camera link for remote visual SLAM: the robot's daemon
Captures frames from a camera, or replays a sequence, and sends the frames to
orbbuf-server over a network with outages of seconds. When the network cannot
carry all frames, it selects frames such that visual SLAM keeps tracking.")
set(CPACK_DEBIAN_ORBBUF-SERVER_PACKAGE_NAME orbbuf-server)
set(CPACK_DEBIAN_ORBBUF-SERVER_DESCRIPTION "camera link for remote visual SLAM: the server
Receives the frames of many robots that run orbbufd, and writes them in order
to files that a SLAM program opens, or to a pipe that it reads live.")
set(CPACK_DEBIAN_ORBBUF-DEV_PACKAGE_NAME orbbuf-dev)
set(CPACK_DEBIAN_ORBBUF-DEV_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_ORBBUF-DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_ORBBUF-DEV_DESCRIPTION "camera link for remote visual SLAM: reading the server's pipe
A header for C and C++ that reads the frames that orbbuf-server writes to a
SLAM program, and an example.")
set(CPACK_DEBIAN_PYTHON3-ORBBUF_PACKAGE_NAME python3-orbbuf)
set(CPACK_DEBIAN_PYTHON3-ORBBUF_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PYTHON3-ORBBUF_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON3-ORBBUF_PACKAGE_DEPENDS python3:any)
set(CPACK_DEBIAN_PYTHON3-ORBBUF_PACKAGE_SUGGESTS "python3-numpy, python3-opencv | python3-pil")
set(CPACK_DEBIAN_PYTHON3-ORBBUF_PACKAGE_CONTROL_EXTRA ${made}/python3-orbbuf/postinst ${made}/python3-orbbuf/prerm)
set(CPACK_DEBIAN_PYTHON3-ORBBUF_DESCRIPTION "camera link for remote visual SLAM: Python reader
Reads the frames that orbbuf-server records in a folder or writes to a pipe,
with a reader like cv2.VideoCapture, and makes data sets of recorded sessions.")
include(CPack)
