// Command lines, one table a program: --name VALUE or --name=VALUE, flags, positional words.
// SPDX-License-Identifier: MIT
#ifndef COMMON_CLI_H
#define COMMON_CLI_H

#include <stdbool.h>

enum cli_kind { CLI_FLAG, CLI_TEXT, CLI_INT, CLI_NUMBER, CLI_SIZE };

struct cli_option {
    const char *name;    // without the dashes
    const char *metavar; // NULL for a flag
    const char *help;    // one line; says what is accepted
    enum cli_kind kind;
    void *value;         // bool*, const char**, int*, double*, int[2] (WIDTHxHEIGHT)
    double min, max;     // accepted range of CLI_INT, CLI_NUMBER and both numbers of CLI_SIZE
    const char *choices; // CLI_TEXT: accepted words "a|b|c", or NULL for any
};

// Parses argv[1..]; words that are no options go to words[] (at most *word_count of them on entry, the number
// found on return). False after one line on stderr: the program then exits with EXIT_COMMAND_LINE.  Lists of
// options end with a NULL name.
bool cli_parse(int argc, char **argv, const struct cli_option *options, const char **words, int *word_count);

// Prints the options of a table, one a line, for --help.
void cli_print_options(const struct cli_option *options);

#define RELIEF_VERSION "0.1.0"

#endif
