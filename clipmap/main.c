// SPDX-License-Identifier: MIT
#include "clipmap/clipmap.h"
#include "common/viewer.h"

int main(int argc, char **argv)
{
    return viewer_main(argc, argv, &clipmap_renderer);
}
