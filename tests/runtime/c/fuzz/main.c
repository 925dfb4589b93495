/* Runs a target of libFuzzer without it, over a file of files, each after its length. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

int open_and_read(const uint8_t* data, size_t size);

int main(int argc, char** argv) {
    FILE* file = argc == 2 ? fopen(argv[1], "rb") : NULL;
    int counts[2] = {0, 0};
    uint8_t length[4];
    if (!file) return 1;
    while (fread(length, 1, 4, file) == 4) {
        size_t size = length[0] | (size_t)length[1] << 8 | (size_t)length[2] << 16 | (size_t)length[3] << 24;
        uint8_t* data = malloc(size ? size : 1); /* of just that size, so that reads beyond it are found */
        if (!data || fread(data, 1, size, file) != size) return 1;
        ++counts[open_and_read(data, size)];
        free(data);
    }
    fclose(file);
    printf("%d opened, %d refused\n", counts[1], counts[0]);
    return 0;
}
