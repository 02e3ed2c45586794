# find_package(equipoise): the targets equipoise::equipoise (shared library) and equipoise::static, for C and C++.
get_filename_component(equipoise_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT TARGET equipoise::equipoise)
    add_library(equipoise::equipoise SHARED IMPORTED)
    set_target_properties(equipoise::equipoise PROPERTIES
        IMPORTED_LOCATION "${equipoise_prefix}/lib/libequipoise_c.so"
        IMPORTED_NO_SONAME TRUE
        INTERFACE_INCLUDE_DIRECTORIES "${equipoise_prefix}/include")
    add_library(equipoise::static STATIC IMPORTED)
    set_target_properties(equipoise::static PROPERTIES
        IMPORTED_LOCATION "${equipoise_prefix}/lib/libequipoise_c.a"
        INTERFACE_LINK_LIBRARIES "pthread;m;dl"
        INTERFACE_INCLUDE_DIRECTORIES "${equipoise_prefix}/include")
endif()
