// SPDX-License-Identifier: MIT
#include "common/viewer.h"
#include "geomipmap/geomipmap.h"

int main(int argc, char **argv)
{
    return viewer_main(argc, argv, &geomipmap_renderer);
}
