/* A world, its manifest, and the boxes of its sectors. */
#ifndef GSGI_WORLD_H
#define GSGI_WORLD_H

#include "internal.h"

#define GSGI_SECTORS_MOST 4096
#define GSGI_FACE_FAR 1e30 /* m; a face at which light does not end is moved so far away */
#define GSGI_NAME_ROOM 256

typedef struct gsgi__sector {
    char file[GSGI_NAME_ROOM];
    uint64_t bytes, memory;
    uint8_t sha256[32];
    double low[3], high[3];           /* of its box, m */
    double fade_low[3], fade_high[3]; /* the same, but that faces which no neighbour shares lie at GSGI_FACE_FAR, or in
                                         the middle of the gap to another box behind them */
    bool low_open[3], high_open[3];   /* which faces no neighbour shares */
    size_t neighbours;                /* where the manifest lists them, while it is read */
    uint32_t class;                   /* no two sectors of a class have light at the same point */
    gsgi_bake* bake;                  /* NULL: not in memory */
    uint32_t serial;                  /* of all that came into memory */
    double clock;                     /* from 0 to 1 */
    float weight;                     /* factor on its light, which follows the clock */
    bool wanted, broken;
} gsgi__sector;

/* How far a sector is from the eye. */
typedef struct gsgi__distance {
    double distance;
    uint32_t number;
} gsgi__distance;

struct gsgi_world {
    gsgi_callbacks callbacks;
    uint64_t scene, budget, memory; /* bytes; of the sectors in memory */
    uint32_t effects, sector_count, resident_count, serial;
    int32_t asked; /* the sector that the host is to read; -1: none */
    double margin, fade;
    bool changing;
    float cutoff, weight_floor, radius; /* of all sectors, once one is in memory */
    uint32_t sharpness;
    gsgi__sector* sectors;
    uint32_t* resident; /* numbers of the sectors in memory, in the order in which they came */
    gsgi__distance* order;
};

/* ---- manifest.c ---- */

/* Fill what the manifest says of the world; its `sectors` are the caller's to release, also after an error. */
gsgi_result gsgi__read_manifest(gsgi_world* world, const uint8_t* text, size_t size);

/* ---- boxes.c ---- */

/* The first two sectors whose boxes share a volume. */
bool gsgi__boxes_overlap(const gsgi_world* world, uint32_t* first, uint32_t* second);

/* Whether two boxes share a part of a face. */
bool gsgi__are_neighbours(const gsgi__sector* a, const gsgi__sector* b);

/* Find where the light of each sector ends, and its class; `scratch` has a place for each sector. */
void gsgi__divide(gsgi_world* world, uint32_t* scratch);

/* The point, m, from which passes see the world: its middle if it lies far from the world's origin, else that. */
void gsgi__world_origin(const gsgi_world* world, double origin[3]);

/* Weight of a sector by its box at a point, m, as runtime/world/boxes.py has it. */
float gsgi__window(const gsgi__sector* sector, double margin, const float point[3]);

#endif
