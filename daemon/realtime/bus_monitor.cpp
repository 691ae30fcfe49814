#include "realtime/bus_monitor.hpp"

#include <algorithm>

namespace eampc::realtime {
namespace {

// Unconfirmed for so many periods is a fault (design: 2 T); until then it may just be late.
constexpr std::int32_t kLatePeriods = 2;

bool same(const control::Frame& a, const control::Frame& b) noexcept {
  return a.id == b.id && a.extended == b.extended && a.length == b.length &&
         std::equal(a.data.begin(), a.data.begin() + std::min<std::ptrdiff_t>(a.length, 8),
                    b.data.begin());
}

}  // namespace

BusMonitor::BusMonitor(std::int64_t period_ns, bool confirms) noexcept
    : period_ns_(period_ns), confirms_(confirms), proved_empty_(!confirms) {}

// Whatever was in flight may be gone or may still wait: from here on only a probe can tell.
void BusMonitor::give_up_frame() noexcept {
  enabled_given_up_ |= in_flight_ && flying_.enabled;
  if (in_flight_) remember(flying_);
  in_flight_ = false;
  sync_in_flight_ = false;
  has_kept_ = false;
  proved_empty_ = !confirms_;
}

std::size_t BusMonitor::first_after_enabled() const noexcept {
  std::size_t first = given_up_count_;
  while (first > 0 && !given_up_[first - 1].enabled) --first;
  return first;
}

void BusMonitor::remember(const Command& given_up) noexcept {
  given_up_too_many_ |= given_up_count_ == kMostGivenUp;
  if (given_up_count_ < kMostGivenUp) given_up_[given_up_count_++] = given_up;
}

bool BusMonitor::tells_apart(const control::Frame& probe) const noexcept {
  if (given_up_too_many_) return false;
  for (std::size_t i = 0; i < first_after_enabled(); ++i) {
    if (same(given_up_[i].frame, probe)) return false;
  }
  return true;
}

// A queue keeps its order: what is older than a confirmed frame has left it, too.
bool BusMonitor::forget_up_to(const control::Frame& confirmed) noexcept {
  for (std::size_t i = 0; i < given_up_count_; ++i) {
    if (!same(given_up_[i].frame, confirmed)) continue;
    for (std::size_t j = i + 1; j < given_up_count_; ++j) given_up_[j - i - 1] = given_up_[j];
    given_up_count_ -= i + 1;
    return true;
  }
  return false;
}

void BusMonitor::on_error_frame(const ErrorReport& report) noexcept {
  if (report.bus_off) {
    ++counters_.bus_offs;
    bus_off_ = true;
    happened_.bus_off = true;
    give_up_frame();
  }
  if (report.restarted) {
    ++counters_.restarts;
    if (!bus_off_) {  // its own frame was lost, or a driver never sends one
      ++counters_.bus_offs;
      happened_.bus_off = true;
    }
    bus_off_ = false;
    passive_ = false;
    give_up_frame();  // what was sent during bus-off is silently lost
  }
  if (report.not_acknowledged) {
    ++counters_.not_acknowledged;
    happened_.not_acknowledged = true;
  }
  counters_.controller_overflows += report.receive_overflow ? 1 : 0;
  if (report.state != ErrorState::kUnsaid) {
    const bool passive = report.state == ErrorState::kPassive;
    counters_.passives += passive && !passive_ ? 1 : 0;
    passive_ = passive;
    happened_.error_passive |= passive;
  }
  report_ = report;
}

void BusMonitor::on_link_lost() noexcept {
  give_up_frame();
  enabled_given_up_ = false;
  given_up_count_ = 0;
  given_up_too_many_ = false;
  link_down_ = true;
  happened_.link_down = true;
  bus_off_ = false;
  passive_ = false;
}

void BusMonitor::on_received() noexcept { heard_since_sent_ = true; }

void BusMonitor::on_foreign_command() noexcept { ++counters_.foreign_commands; }

bool BusMonitor::admit(const Command& command, std::int64_t now_ns) noexcept {
  if (!confirms_) return true;
  // Other nodes are heard, so they would have acknowledged: the confirmation was lost, not the bus.
  if (in_flight_ && !command.enabled && heard_since_sent_ && now_ns - sent_at_ >= kLostNs) {
    ++counters_.lost_confirmations;
    give_up_frame();
  }
  if (in_flight_) {
    ++counters_.withheld_commands;
    kept_ = command;
    kept_.kept_at = now_ns;
    has_kept_ = true;
    return false;
  }
  const bool waited = command.kept_at != kNotKept;
  // A running loop replaces a kept command every period; an older one is of a loop that slept.
  const bool outdated =
      waited && command.enabled && now_ns - command.kept_at > period_ns_ + period_ns_ / 2;
  const bool admitted =
      !outdated && (proved_empty_ || (!command.enabled && tells_apart(command.frame)));
  counters_.withheld_commands += admitted || waited ? 0 : 1;
  return admitted;
}

void BusMonitor::on_sent(const Command& command, std::int64_t now_ns) noexcept {
  link_down_ = false;
  if (!confirms_) return;
  in_flight_ = true;
  flying_ = command;
  sent_at_ = now_ns;
  heard_since_sent_ = false;
}

void BusMonitor::on_refused() noexcept { happened_.send_refused = true; }

bool BusMonitor::admit_sync(std::int64_t now_ns) const noexcept {
  return !sync_in_flight_ || now_ns - sync_sent_at_ >= kLostNs;
}

void BusMonitor::on_sync_sent(const control::Frame& sync, std::int64_t now_ns) noexcept {
  link_down_ = false;
  if (!confirms_) return;
  sync_in_flight_ = true;
  sync_ = sync;
  sync_sent_at_ = now_ns;
}

bool BusMonitor::on_confirmed(const control::Frame& frame, Command& kept) noexcept {
  if (sync_in_flight_ && same(frame, sync_)) {
    sync_in_flight_ = false;
    return false;
  }
  if (!in_flight_ || !same(frame, flying_.frame)) {
    ++counters_.stray_confirmations;
    forget_up_to(frame);
    return false;
  }
  in_flight_ = false;
  // Was it this one, or an older one of the same bytes? Then this one may still wait.
  if (forget_up_to(frame)) {
    remember(flying_);
  } else if (!given_up_too_many_) {
    given_up_count_ = 0;
  }
  bus_off_ = false;  // a controller that is off the bus confirms nothing
  if (!flying_.enabled) {
    proved_empty_ = true;
    enabled_given_up_ = false;
  }
  if (!has_kept_) return false;
  has_kept_ = false;
  kept = kept_;
  return proved_empty_ || !kept.enabled;
}

std::int32_t BusMonitor::unconfirmed_periods(std::int64_t now_ns) const noexcept {
  if (!in_flight_) return 0;
  constexpr std::int64_t kMost = 1'000'000;
  const std::int64_t periods = (now_ns - sent_at_ + period_ns_ / 2) / period_ns_;
  return static_cast<std::int32_t>(std::clamp<std::int64_t>(periods, 1, kMost));
}

control::BusHealth BusMonitor::health(std::int64_t now_ns) const noexcept {
  control::BusHealth health = happened_;
  health.link_down |= link_down_;
  health.bus_off |= bus_off_;
  health.error_passive |= passive_;
  health.unconfirmed_periods = unconfirmed_periods(now_ns);
  health.queue_proved_empty = proved_empty_;
  return health;
}

control::BusHealth BusMonitor::take_health(std::int64_t now_ns) noexcept {
  const control::BusHealth result = health(now_ns);
  happened_ = {};
  return result;
}

bool BusMonitor::stale_command_possible(std::int64_t now_ns) const noexcept {
  return enabled_given_up_ ||
         (in_flight_ && flying_.enabled && unconfirmed_periods(now_ns) >= kLatePeriods);
}

}  // namespace eampc::realtime
