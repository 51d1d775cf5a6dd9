/* SPDX-License-Identifier: Apache-2.0 */
/* What a user of orbbuf_pipe.h writes: prints a line for each image on its standard input.
 * Usage: orbbuf-pipe-reader pgm|mjpeg */
#include <inttypes.h>
#include <orbbuf_pipe.h>

int main(int argc, char** argv) {
  struct orbbuf_reader reader;
  struct orbbuf_image image;
  const uint8_t* jpeg;
  size_t size;
  int got;
  const int is_pgm = argc > 1 && strcmp(argv[1], "pgm") == 0;
  orbbuf_reader_init(&reader, stdin);
  for (;;) {
    got = is_pgm ? orbbuf_read_pgm(&reader, &image) : orbbuf_read_jpeg(&reader, &jpeg, &size);
    if (got != 1) break;
    if (is_pgm) {
      printf("image %" PRIu64 " %.9f %" PRIu32 "x%" PRIu32 " camera %d\n", image.seq, image.t,
             image.width, image.height, (int)image.camera);
    } else {
      printf("image of %zu bytes\n", size);
    }
  }
  printf("end of pipe: %s\n", got == 0 ? "whole" : reader.error);
  orbbuf_reader_free(&reader);
  return got == 0 ? 0 : 1;
}
