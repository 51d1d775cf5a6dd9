# SPDX-License-Identifier: Apache-2.0
# What is installed where, and the Debian packages made of it: one for each component.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
set(debian ${PROJECT_SOURCE_DIR}/toolchain/debian)
set(made ${PROJECT_BINARY_DIR}/debian)
set(CPACK_PACKAGE_CONTACT "ORBBuf maintainers <maintainers@users.noreply.h-seed-9b03b2c3.example>")
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)

install(TARGETS orbbufd COMPONENT orbbufd)
install(TARGETS orbbuf-server COMPONENT orbbuf-server)

# The C reader of the server's pipe, for find_package(orbbuf) and for pkg-config.
add_library(orbbuf_pipe INTERFACE)
set_target_properties(orbbuf_pipe PROPERTIES EXPORT_NAME pipe)
target_include_directories(orbbuf_pipe INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/server/sink>
                                                 $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
install(FILES server/sink/orbbuf_pipe.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT orbbuf-dev)
install(DIRECTORY server/sink/examples DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/orbbuf-dev COMPONENT orbbuf-dev)
install(TARGETS orbbuf_pipe EXPORT orbbuf)
install(EXPORT orbbuf NAMESPACE orbbuf:: FILE orbbufConfig.cmake DESTINATION ${CMAKE_INSTALL_DATADIR}/cmake/orbbuf
        COMPONENT orbbuf-dev)
write_basic_package_version_file(${made}/orbbufConfigVersion.cmake COMPATIBILITY SameMajorVersion ARCH_INDEPENDENT)
install(FILES ${made}/orbbufConfigVersion.cmake DESTINATION ${CMAKE_INSTALL_DATADIR}/cmake/orbbuf COMPONENT orbbuf-dev)
configure_file(${debian}/orbbuf.pc.in ${made}/orbbuf.pc @ONLY)
install(FILES ${made}/orbbuf.pc DESTINATION ${CMAKE_INSTALL_DATADIR}/pkgconfig COMPONENT orbbuf-dev)

# compressed(OUTPUT SOURCE COMMAND...): gzips what COMMAND prints, which is made from SOURCE; the same each time.
function(compressed output source)
  add_custom_command(OUTPUT ${output} COMMAND ${ARGN} | gzip -9n > ${output} DEPENDS ${source} VERBATIM)
  set_property(GLOBAL APPEND PROPERTY orbbuf_compressed ${output})
endfunction()

foreach(component orbbufd orbbuf-server orbbuf-dev)
  set(changelog ${PROJECT_SOURCE_DIR}/CHANGELOG.md)
  compressed(${made}/${component}/changelog.Debian.gz ${changelog} ${debian}/changelog.sh ${changelog} ${component}
             ${CPACK_DEBIAN_PACKAGE_RELEASE} ${CPACK_PACKAGE_CONTACT})
  install(FILES ${made}/${component}/changelog.Debian.gz ${debian}/copyright
          DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${component} COMPONENT ${component})
endforeach()

set(orbbufd_options --config --set --check-config --list-cameras --probe --version --help)
set(orbbuf-server_options check export status --config --set --check-config --version --help --layout --png-names)
foreach(component orbbufd orbbuf-server)
  foreach(page ${component}.8 ${component}.toml.5)
    compressed(${made}/${page}.gz ${PROJECT_SOURCE_DIR}/docs/man/${page} cat ${PROJECT_SOURCE_DIR}/docs/man/${page})
    string(REGEX MATCH ".$" section ${page})
    install(FILES ${made}/${page}.gz DESTINATION ${CMAKE_INSTALL_MANDIR}/man${section} COMPONENT ${component})
  endforeach()

  file(STRINGS config/${component}.toml lines REGEX "^(\\[[a-z]+|[a-z_]+ = )")
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS config/${component}.toml)
  set(keys)
  foreach(line IN LISTS lines)
    if(line MATCHES "^\\[([a-z]+)")
      set(table ${CMAKE_MATCH_1})
    elseif(line MATCHES "^([a-z_]+) = ")
      string(APPEND keys "${table}.${CMAKE_MATCH_1} ")
    endif()
  endforeach()
  string(REPLACE - _ name ${component})
  list(JOIN ${component}_options " " options)
  configure_file(${debian}/completion.in ${made}/${component}/completion @ONLY)
  install(FILES ${made}/${component}/completion DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions
          RENAME ${component} COMPONENT ${component})

  file(WRITE ${made}/${component}/conffiles "/etc/orbbuf/${component}.toml\n")
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

get_property(compressed GLOBAL PROPERTY orbbuf_compressed)
add_custom_target(orbbuf_compressed ALL DEPENDS ${compressed})

set(CPACK_GENERATOR DEB)
set(CPACK_SET_DESTDIR ON)
set(CPACK_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_COMPONENTS_ALL orbbufd orbbuf-server orbbuf-dev)
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
  set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${CMAKE_SYSROOT}/lib/${CMAKE_LIBRARY_ARCHITECTURE}
      ${CMAKE_SYSROOT}/usr/lib/${CMAKE_LIBRARY_ARCHITECTURE})
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
include(CPack)
