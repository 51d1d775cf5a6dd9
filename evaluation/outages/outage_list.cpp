// SPDX-License-Identifier: Apache-2.0
#include "evaluation/outages/outage_list.hpp"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>

#include "common/decimal.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr const char* kTitle = "# orbbuf outage list 1";
constexpr const char* kColumns = "image,number,capture_s,arrival_s,quality";

[[noreturn]] void fail(const std::filesystem::path& file, int line, const std::string& why) {
  throw std::runtime_error(fmt::format("{}:{}: {}", file.string(), line, why));
}

ListedArrival parse(const std::string& line, const std::filesystem::path& file, int number) {
  std::istringstream rest(line);
  ListedArrival arrival;
  std::array<char, 3> commas{};
  if (!std::getline(rest, arrival.image, ',') ||
      !(rest >> arrival.number >> commas[0] >> arrival.capture_s >> commas[1] >>
        arrival.arrival_s >> commas[2] >> arrival.quality) ||
      commas != std::array{',', ',', ','} || arrival.image.find('/') != std::string::npos) {
    fail(file, number, fmt::format("not {}", kColumns));
  }
  return arrival;
}

}  // namespace

void write_list(const std::filesystem::path& file, const OutageList& list) {
  std::ofstream out(file);
  out << fmt::format(
      "{}\n# sequence {}\n# sha256 {}\n# policy {}\n# link {}\n# lateness_s {:.3f}\n"
      "# live_again_s {:.3f}\n# outage_begin_s {:.6f}\n# outage_length_s {:.6f}\n{}\n",
      kTitle, list.sequence, list.sha256, list.policy, list.link, list.lateness_s,
      list.live_again_s, list.begin_s, list.length_s, kColumns);
  for (const ListedArrival& a : list.arrivals) {
    out << fmt::format("{},{},{:.6f},{:.6f},{}\n", a.image, a.number, a.capture_s, a.arrival_s,
                       a.quality);
  }
  if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
}

OutageList read_list(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) throw std::runtime_error("cannot read " + file.string());
  OutageList list;
  const std::map<std::string, std::string*> words = {{"sequence", &list.sequence},
                                                     {"sha256", &list.sha256},
                                                     {"policy", &list.policy},
                                                     {"link", &list.link}};
  const std::map<std::string, double*> numbers = {{"lateness_s", &list.lateness_s},
                                                  {"live_again_s", &list.live_again_s},
                                                  {"outage_begin_s", &list.begin_s},
                                                  {"outage_length_s", &list.length_s}};
  std::string line;
  if (!std::getline(in, line) || line != kTitle) fail(file, 1, fmt::format("not \"{}\"", kTitle));
  for (int number = 2; std::getline(in, line); ++number) {
    if (line == kColumns) continue;
    if (!line.starts_with("# ")) {
      list.arrivals.push_back(parse(line, file, number));
      continue;
    }
    const auto space = line.find(' ', 2);
    const std::string key = line.substr(2, space - 2);
    const std::string value = space == std::string::npos ? "" : line.substr(space + 1);
    if (const auto word = words.find(key); word != words.end()) *word->second = value;
    const auto known = numbers.find(key);
    if (known == numbers.end()) continue;
    const auto parsed = parse_number<double>(value);
    if (!parsed) fail(file, number, key + ": not a number");
    *known->second = *parsed;
  }
  return list;
}

std::vector<std::filesystem::path> images_of(const std::filesystem::path& sequence) {
  std::vector<std::filesystem::path> images;
  for (const auto& entry : std::filesystem::directory_iterator(sequence / "images")) {
    images.push_back(entry.path());
  }
  std::ranges::sort(images);
  if (images.empty()) throw std::runtime_error("no images in " + (sequence / "images").string());
  return images;
}

std::string sha256_of(const std::vector<std::filesystem::path>& images) {
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> digest(EVP_MD_CTX_new(),
                                                                       EVP_MD_CTX_free);
  EVP_DigestInit_ex(digest.get(), EVP_sha256(), nullptr);
  for (const auto& image : images) {
    std::ifstream in(image, std::ios::binary);
    if (!in) throw std::runtime_error("cannot read " + image.string());
    const std::string bytes(std::istreambuf_iterator<char>(in), {});
    EVP_DigestUpdate(digest.get(), bytes.data(), bytes.size());
  }
  std::array<unsigned char, EVP_MAX_MD_SIZE> sum{};
  unsigned size = 0;
  EVP_DigestFinal_ex(digest.get(), sum.data(), &size);
  std::string text;
  for (unsigned i = 0; i < size; ++i) text += fmt::format("{:02x}", sum[i]);
  return text;
}

}  // namespace orbbuf::evaluation
