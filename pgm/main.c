// SPDX-License-Identifier: MIT
#include "common/viewer.h"
#include "pgm/pgm.h"

int main(int argc, char **argv)
{
    return viewer_main(argc, argv, &pgm_renderer);
}
