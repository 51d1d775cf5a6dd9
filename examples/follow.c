/* SPDX-License-Identifier: Apache-2.0 */
/* Follows a robot's stream, one line an image, through outages and restarts of orbbuf-server:
 *
 *   [robot.NAME.slam]                                cc follow.c -o follow
 *   fifo = "/var/lib/orbbuf-server/{robot}.fifo"     sudo ./follow /var/lib/orbbuf-server/NAME.fifo
 *
 * The server makes the FIFO in the robot's first session; docs/systemd.md has one for another user.
 * As command = "follow" it reads its standard input, for one session. */
#include <inttypes.h>
#include <orbbuf/pipe.h>

int main(int argc, char** argv) {
  struct orbbuf_reader reader;
  struct orbbuf_image image;
  int got;
  if (argc < 2) {
    orbbuf_reader_init(&reader, stdin);
  } else if (orbbuf_reader_follow(&reader, argv[1])) {
    fprintf(stderr, "%s: %s\n", argv[1], reader.error);
    return 1;
  }
  while ((got = orbbuf_read(&reader, &image)) == 1) {
    printf("%s %" PRIu64 " %.6f camera %d: %zu bytes", image.session, image.seq, image.t,
           (int)image.camera, image.size);
    if (image.quality) printf(", quality %d", image.quality);
    if (image.whole_bytes) printf(", reduced from %" PRIu32, image.whole_bytes);
    if (image.sample_count) printf(", %zu samples", image.sample_count);
    putchar('\n');
    fflush(stdout);
  }
  if (got < 0) fprintf(stderr, "%s\n", reader.error);
  orbbuf_reader_free(&reader);
  return got < 0;
}
