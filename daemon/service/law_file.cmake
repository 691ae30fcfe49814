# The loader of the law file: also linked by the Python module and the tests, so a target of its own.
add_library(eampc_law_file STATIC
  ${CMAKE_CURRENT_LIST_DIR}/law_file.cpp
  ${CMAKE_CURRENT_LIST_DIR}/law_sections.cpp
  ${CMAKE_CURRENT_LIST_DIR}/safety_section.cpp
  ${CMAKE_CURRENT_LIST_DIR}/law_tables_section.cpp
  ${CMAKE_CURRENT_LIST_DIR}/law_tables.cpp
  ${CMAKE_CURRENT_LIST_DIR}/law_cost.cpp
  ${CMAKE_CURRENT_LIST_DIR}/law_packing.cpp)
target_compile_definitions(eampc_law_file PUBLIC MSGPACK_NO_BOOST)
target_link_libraries(eampc_law_file PUBLIC eampc_control ZLIB::ZLIB)
