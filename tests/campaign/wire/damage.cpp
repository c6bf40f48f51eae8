// SPDX-License-Identifier: GPL-3.0-or-later
#include "damage.hpp"

#include <fmt/format.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <fstream>
#include <functional>
#include <map>
#include <random>
#include <stdexcept>
#include <telefab/test/loopback.hpp>
#include <telefab/transfer/chunk_spool.hpp>
#include <telefab/wire/message.hpp>

namespace telefab::test {
namespace {

using Bytes = std::vector<std::byte>;

/// A job as it went over the line.
struct Recorded {
  Offer offer;
  std::vector<SendChunk> chunks;
  StackEnd end;
};

Message read_message(const std::filesystem::path& path) {
  std::ifstream in{path, std::ios::binary};
  const std::string text{std::istreambuf_iterator<char>{in}, {}};
  FrameReader reader;
  reader.feed(std::as_bytes(std::span{text}));
  return from_frame(reader.take().value().value()).value();
}

Recorded record(Sites& sites, const std::string& id) {
  const auto folder = sites.folder() / "fab" / "jobs" / id;
  Recorded job{std::get<Offer>(read_message(folder / "offer")), {}, std::get<StackEnd>(read_message(folder / "end"))};
  // Not signed: the line itself is on trial.
  job.offer.public_key.clear();
  job.offer.signature.clear();
  job.end.signature.clear();
  const auto spool = ChunkSpool::open(folder / "chunks").value();
  for (std::uint32_t i = 0; i < spool.chunk_count(); ++i) {
    const auto chunk = spool.read(i).value();
    job.chunks.push_back({id, chunk.sequence, chunk.first_layer, chunk.layer_count, chunk.payload, chunk.chain});
  }
  return job;
}

/// The same job under another name.
Recorded renamed(Recorded job, const std::string& id) {
  job.offer.job = job.end.job = id;
  for (SendChunk& chunk : job.chunks) chunk.job = id;
  return job;
}

Bytes bytes_of(const Message& message) { return to_bytes(to_frame(message)).value(); }

struct Answer {
  std::string fault;   ///< its name; empty where the connection ended without one
  int kept = 0;        ///< chunks acknowledged
  bool whole = false;  ///< the stack was taken
};

/// Says hello and these bytes to the fab and hears it out.
Answer converse(std::uint16_t port, std::span<const Bytes> messages) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const timeval limit{60, 0};
  const int on = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
  ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  const sockaddr_in address = loopback(port);
  if (::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
    throw std::runtime_error{"the fab is gone"};
  Bytes all = bytes_of(Hello{kProtocolVersion, Side::ScanSite, "campaign", {}, {}});
  for (const Bytes& each : messages) all.insert(all.end(), each.begin(), each.end());
  (void)::send(fd, all.data(), all.size(), MSG_NOSIGNAL);
  ::shutdown(fd, SHUT_WR);
  Answer answer;
  FrameReader reader;
  std::array<std::byte, 4096> buffer{};
  for (ssize_t got = 0; (got = ::recv(fd, buffer.data(), buffer.size(), 0)) > 0;) {
    reader.feed(std::span{buffer}.first(static_cast<std::size_t>(got)));
    for (auto frame = reader.take(); frame && *frame; frame = reader.take()) {
      const auto message = from_frame(**frame);
      if (!message) continue;
      if (std::holds_alternative<ChunkStored>(*message)) ++answer.kept;
      if (std::holds_alternative<StackStored>(*message)) answer.whole = true;
      if (const auto* fault = std::get_if<Fault>(&*message); fault && answer.fault.empty())
        answer.fault = fault->error.what.substr(0, fault->error.what.find(':'));
    }
  }
  ::close(fd);
  return answer;
}

struct Trial {
  std::vector<Bytes> messages;  ///< behind the hello
  int good_chunks = 0;          ///< that may be acknowledged
};

struct Kind {
  const char* name;
  int share;         ///< of 1000
  bool needs_a_job;  ///< of its own: the fab gives the job up
  std::function<Trial(const Recorded&, const Recorded& other, std::mt19937&)> make;
};

Trial trial_of(const Recorded& job, const std::vector<SendChunk>& chunks, int good) {
  Trial trial{{bytes_of(job.offer)}, good};
  for (const SendChunk& chunk : chunks) trial.messages.push_back(bytes_of(chunk));
  return trial;
}

std::vector<Kind> kinds() {
  return {
      {"a bit flipped in a frame", 800, false,
       [](const Recorded& job, const Recorded&, std::mt19937& random) {
         Trial trial = trial_of(job, {job.chunks[0]}, 0);
         Bytes& frame = trial.messages.back();
         frame[random() % frame.size()] ^= std::byte{1} << (random() % 8);
         return trial;
       }},
      {"bytes of a frame lost", 100, false,
       [](const Recorded& job, const Recorded&, std::mt19937& random) {
         Trial trial = trial_of(job, {job.chunks[0], job.chunks[1]}, 0);
         Bytes& frame = trial.messages[1];
         const auto from = static_cast<std::ptrdiff_t>(random() % (frame.size() - 1));
         const auto many = 1 + static_cast<std::ptrdiff_t>(random() % std::min<std::size_t>(frame.size() - from, 64));
         frame.erase(frame.begin() + from, frame.begin() + from + many);
         return trial;
       }},
      {"bytes pushed into a frame", 50, false,
       [](const Recorded& job, const Recorded&, std::mt19937& random) {
         Trial trial = trial_of(job, {job.chunks[0], job.chunks[1]}, 0);
         Bytes& frame = trial.messages[1];
         frame.insert(frame.begin() + static_cast<std::ptrdiff_t>(random() % frame.size()), 1 + random() % 16,
                      static_cast<std::byte>(random()));
         return trial;
       }},
      {"a payload changed, its frame's sum right", 10, true,
       [](const Recorded& job, const Recorded&, std::mt19937& random) {
         SendChunk chunk = job.chunks[0];
         chunk.payload[random() % chunk.payload.size()] ^= std::byte{1} << (random() % 8);
         return trial_of(job, {chunk}, 0);
       }},
      {"a payload changed, frame and chain right", 10, true,
       [](const Recorded& job, const Recorded&, std::mt19937& random) {
         Recorded changed = job;
         const std::size_t which = random() % changed.chunks.size();
         SendChunk& chunk = changed.chunks[which];
         chunk.payload[random() % chunk.payload.size()] ^= std::byte{1} << (random() % 8);
         Digest chain{};
         for (SendChunk& each : changed.chunks)
           chain = each.chain = chain_after(chain, each.sequence, each.first_layer, each.layer_count, each.payload);
         changed.end.chain = chain;
         Trial trial = trial_of(changed, changed.chunks, static_cast<int>(job.chunks.size()));
         trial.messages.push_back(bytes_of(changed.end));
         return trial;
       }},
      {"two chunks swapped", 8, true,
       [](const Recorded& job, const Recorded&, std::mt19937& random) {
         std::vector<SendChunk> chunks = job.chunks;
         const std::size_t which = random() % (chunks.size() - 1);
         std::swap(chunks[which], chunks[which + 1]);
         return trial_of(job, chunks, static_cast<int>(which));
       }},
      {"a chunk dropped", 8, true,
       [](const Recorded& job, const Recorded&, std::mt19937& random) {
         std::vector<SendChunk> chunks = job.chunks;
         const auto which = static_cast<std::ptrdiff_t>(random() % (chunks.size() - 1));
         chunks.erase(chunks.begin() + which);
         return trial_of(job, chunks, static_cast<int>(which));
       }},
      {"a chunk repeated", 7, true,
       [](const Recorded& job, const Recorded&, std::mt19937& random) {
         std::vector<SendChunk> chunks = job.chunks;
         const auto which = static_cast<std::ptrdiff_t>(random() % chunks.size());
         chunks.insert(chunks.begin() + which, chunks[static_cast<std::size_t>(which)]);
         return trial_of(job, chunks, static_cast<int>(which) + 1);
       }},
      {"a chunk of another job", 7, true,
       [](const Recorded& job, const Recorded& other, std::mt19937& random) {
         std::vector<SendChunk> chunks = job.chunks;
         const std::size_t which = random() % std::min(chunks.size(), other.chunks.size());
         chunks[which] = other.chunks[which];
         chunks[which].job = job.offer.job;
         // Every job's chain begins alike: a strange first chunk is found out by the one behind it.
         return trial_of(job, chunks, which == 0 ? 1 : static_cast<int>(which));
       }},
  };
}

}  // namespace

int damage_campaign(Sites& sites, int wanted) {
  sites.start_fab();
  sites.start_scan(sites.fab_port());
  const std::string first = sites.submit();
  std::vector<std::string> words{(sites.folder() / "torus.xyz").string(),
                                 "--machine",
                                 "toy",
                                 "--height-mm",
                                 "5.1",
                                 "--layer-mm",
                                 "0.01",
                                 "--coding",
                                 "exact"};
  if (!sites.wait_until_kept(first, 300)) throw std::runtime_error{"the job does not arrive"};
  sites.set_scan(words);
  const std::string second = sites.submit();
  if (!sites.wait_until_kept(second, 300)) throw std::runtime_error{"the job does not arrive"};
  Recorded job = record(sites, first);
  const Recorded other = record(sites, second);
  sites.kill_scan();

  std::mt19937 random{11};
  const auto all = kinds();
  int trials = 0;
  int taken = 0;
  int jobs = 0;
  fmt::print(
      "| damage | tried | refused by name | ended within a frame | taken | names |\n|---|---|---|---|---|---|\n");
  for (const Kind& kind : all) {
    const int many = std::max(1, static_cast<int>(static_cast<std::int64_t>(wanted) * kind.share / 1000));
    std::map<std::string, int> names;
    int wrong = 0;
    Recorded named = renamed(job, "d0");
    for (int i = 0; i < many; ++i) {
      if (kind.needs_a_job) named = renamed(job, fmt::format("d{}", ++jobs));
      const Trial trial = kind.make(named, other, random);
      const Answer answer = converse(sites.fab_port(), trial.messages);
      if (answer.whole || answer.kept > trial.good_chunks) ++wrong;
      ++names[answer.fault];
      ++trials;
    }
    taken += wrong;
    std::string list;
    const int unnamed = names[""];
    names.erase("");
    for (const auto& [name, count] : names) list += fmt::format("{} {}, ", name, count);
    fmt::print("| {} | {} | {} | {} | {} | {} |\n", kind.name, many, many - unnamed, unnamed, wrong, list);
    std::fflush(stdout);
  }
  // The daemon is unharmed: the recorded job itself is taken under a new name.
  Recorded good = renamed(job, "unharmed");
  Trial trial = trial_of(good, good.chunks, 0);
  trial.messages.push_back(bytes_of(good.end));
  const bool is_well = converse(sites.fab_port(), trial.messages).whole;
  fmt::print("{} damaged conversations, {} taken; afterwards the undamaged one is {}\n", trials, taken,
             is_well ? "taken" : "REFUSED");
  return taken == 0 && is_well ? 0 : 5;
}

}  // namespace telefab::test
