// SPDX-License-Identifier: Apache-2.0
import { spawn } from "node:child_process";

export const sleep = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** Settings as a program's arguments. */
export const set = (values) => Object.entries(values).flatMap(([key, value]) => ["--set", `${key}=${value}`]);

/** A program, its output, and a way to wait for a line of it. */
export class Program {
  constructor(command, args) {
    this.output = "";
    this.process = spawn(command, args, { stdio: ["ignore", "pipe", "pipe"] });
    this.ended = new Promise((resolve) => this.process.on("close", resolve));
    for (const stream of [this.process.stdout, this.process.stderr]) stream.on("data", (text) => (this.output += text));
  }
  async line(pattern) {
    for (let i = 0; i < 300; ++i) {
      const match = this.output.match(pattern);
      if (match) return match;
      await sleep(100);
    }
    throw new Error(`no ${pattern} in:\n${this.output}`);
  }
  async stop() {
    this.process.kill("SIGTERM");
    await this.ended;
  }
}
