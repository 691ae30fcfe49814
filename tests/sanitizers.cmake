# EAMPC_SANITIZE: a build that watches itself. tools/sanitize makes and runs each of them.
set(EAMPC_SANITIZE "" CACHE STRING
  "address (and undefined behaviour), thread, realtime and fuzzer (clang)")
set_property(CACHE EAMPC_SANITIZE PROPERTY STRINGS "" address thread realtime fuzzer)
if(EAMPC_SANITIZE STREQUAL "")
  return()
endif()

set(sanitizer_address -fsanitize=address,undefined -fno-sanitize-recover=all)
set(sanitizer_thread -fsanitize=thread)
set(sanitizer_realtime -fsanitize=realtime)
set(sanitizer_fuzzer -fsanitize=fuzzer-no-link ${sanitizer_address})
if(NOT DEFINED sanitizer_${EAMPC_SANITIZE})
  message(FATAL_ERROR
    "EAMPC_SANITIZE is ${EAMPC_SANITIZE}; it must be address, thread, realtime or fuzzer")
endif()
if(EAMPC_SANITIZE MATCHES "^(realtime|fuzzer)$" AND NOT CMAKE_CXX_COMPILER_ID MATCHES Clang)
  message(FATAL_ERROR
    "EAMPC_SANITIZE=${EAMPC_SANITIZE} needs clang; configure with -DCMAKE_CXX_COMPILER=clang++-22")
endif()
add_compile_options(${sanitizer_${EAMPC_SANITIZE}} -fno-omit-frame-pointer -g1)
add_link_options(${sanitizer_${EAMPC_SANITIZE}})
add_compile_definitions(EAMPC_SANITIZE_${EAMPC_SANITIZE})
